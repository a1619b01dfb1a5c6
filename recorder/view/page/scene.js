"use strict";
// Draws the town, the drive, clouds, pictures and paths of one page. The world is ENU in metres, z up.
const $ = name => document.getElementById(name);
const meta = JSON.parse($("meta").textContent);
const TYPES = { f4: Float32Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array };

function say(text) {
  $("note").textContent = text;
  $("note").hidden = !text;
}

async function unpack() {
  const text = $("data").textContent.trim();
  $("data").remove();
  const packed = Uint8Array.from(atob(text), sign => sign.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function start(buffer) {
  const array = part => new TYPES[part.type](buffer, part.at, part.count);
  const renderer = new THREE.WebGLRenderer({ canvas: $("view"), antialias: true });
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0x9fb6c8);
  scene.fog = new THREE.Fog(0x9fb6c8, 150, 900);
  scene.add(new THREE.HemisphereLight(0xffffff, 0x9a927f, 3.2));
  const sun = new THREE.DirectionalLight(0xfff2dd, 2.6);
  sun.position.set(-0.5, -0.7, 1.2);
  scene.add(sun);
  const camera = new THREE.PerspectiveCamera(55, 1, 0.3, 4000);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  controls.maxPolarAngle = 0.495 * Math.PI;
  controls.enableDamping = false;

  // The town: coordinates as whole steps from its lowest corner.
  const town = new THREE.Group();
  for (const part of meta.town) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(array(part.position), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(array(part.colour), 3, true));
    geometry.setIndex(new THREE.BufferAttribute(array(part.index), 1));
    const look = { vertexColors: true, flatShading: true, side: THREE.DoubleSide };
    if (part.on_top) Object.assign(look, { polygonOffset: true, polygonOffsetFactor: -2, polygonOffsetUnits: -8 });
    const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(look));
    mesh.position.set(...part.low);
    mesh.scale.set(...part.step);
    mesh.frustumCulled = false;
    town.add(mesh);
  }
  scene.add(town);

  function line(positions, colour, opacity = 1) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    const look = new THREE.LineBasicMaterial({ color: new THREE.Color(colour), fog: false, opacity, transparent: opacity < 1 });
    const drawn = new THREE.Line(geometry, look);
    drawn.frustumCulled = false;
    scene.add(drawn);
    return drawn;
  }
  for (const part of meta.lanes) line(array(part), "#9fe3ff", 0.3);
  for (const path of meta.paths) {
    line(array(path.position), path.colour);
    const row = document.createElement("span");
    const mark = document.createElement("i");
    mark.style.background = path.colour;
    row.append(mark, path.name);
    $("legend").append(row);
  }

  // Rows of times, and where a time lies between them.
  function between(times, t) {
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle; else high = middle;
    }
    const span = times[high] - times[low];
    return [low, high, span > 0 ? Math.min(Math.max((t - times[low]) / span, 0), 1) : 0];
  }
  const lastBefore = (times, t) => {
    const [low, high] = between(times, t);
    return times[high] <= t ? high : times[low] <= t ? low : -1;
  };

  const ego = meta.ego && { time: array(meta.ego.time), position: array(meta.ego.position), quat: array(meta.ego.quat) };
  const car = new THREE.Group();
  if (ego) {
    const [length, width, height] = meta.ego.size;
    const paint = new THREE.MeshLambertMaterial({ color: 0xf4f4f0 });
    const glass = new THREE.MeshLambertMaterial({ color: 0x26323c });
    const body = new THREE.Mesh(new THREE.BoxGeometry(length, width, 0.55 * height), paint);
    body.position.set(meta.ego.ahead, 0, 0.4 * height);
    const cabin = new THREE.Mesh(new THREE.BoxGeometry(0.5 * length, 0.86 * width, 0.36 * height), glass);
    cabin.position.set(meta.ego.ahead - 0.06 * length, 0, 0.82 * height);
    car.add(body, cabin);
    scene.add(car);
  }

  let boxes = null;
  if (meta.actors) {
    const size = array(meta.actors.size), tint = array(meta.actors.colour), count = meta.actors.count;
    boxes = { time: array(meta.actors.time), pose: array(meta.actors.pose), size, count };
    boxes.mesh = new THREE.InstancedMesh(new THREE.BoxGeometry(1, 1, 1), new THREE.MeshLambertMaterial(), count);
    boxes.mesh.frustumCulled = false;
    for (let k = 0; k < count; k++) {
      boxes.mesh.setColorAt(k, new THREE.Color().setRGB(tint[3 * k] / 255, tint[3 * k + 1] / 255, tint[3 * k + 2] / 255, THREE.SRGBColorSpace));
    }
    scene.add(boxes.mesh);
  }

  let cloud = null;
  if (meta.clouds) {
    const shade = array(meta.clouds.shade), table = array(meta.clouds.table);
    const colour = new Uint8Array(3 * shade.length);
    for (let k = 0; k < shade.length; k++) for (let c = 0; c < 3; c++) colour[3 * k + c] = table[3 * shade[k] + c];
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(array(meta.clouds.position), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colour, 3, true));
    const look = new THREE.PointsMaterial({ size: 2.5, sizeAttenuation: false, vertexColors: true, fog: false });
    cloud = { time: array(meta.clouds.time), first: array(meta.clouds.first), points: new THREE.Points(geometry, look) };
    cloud.points.position.set(...meta.clouds.low);
    cloud.points.scale.set(...meta.clouds.step);
    cloud.points.frustumCulled = false;
    scene.add(cloud.points);
    for (const [text, value] of [["off", 0], ["now", 1], ["last 2 s", Math.round(2 / meta.clouds.period)], ["all", 1e9]]) {
      $("trail").add(new Option(text, value));
    }
    $("trail").selectedIndex = 2;
  } else $("trail-label").hidden = true;

  const pictures = meta.pictures && { time: array(meta.pictures.time), first: array(meta.pictures.first), shown: -1 };
  const bytes = pictures && array(meta.pictures.jpeg);
  $("picture").hidden = !pictures;
  const image = $("picture").querySelector("img");

  // The sky, north up, the horizon outside: filled marks are received, rings are blocked.
  const sky = meta.sky && { names: meta.sky.names, ways: meta.sky.ways, shown: -1, counts: [] };
  const plot = $("sky").querySelector("svg");
  function mark(kind, attributes, text = "") {
    const made = document.createElementNS("http://www.w3.org/2000/svg", kind);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.textContent = text;
    return made;
  }
  if (sky) {
    for (const name of ["time", "first", "name", "place", "way"]) sky[name] = array(meta.sky[name]);
    for (const r of [30, 60, 90]) plot.append(mark("circle", { r }));
    for (const [text, x, y] of [["N", 0, -99], ["E", 99, 0], ["S", 0, 99], ["W", -99, 0]]) plot.append(mark("text", { x, y }, text));
    sky.marks = plot.appendChild(mark("g", {}));
    for (const [name, colour] of sky.ways) {
      const row = document.createElement("div");
      row.style.color = colour;
      sky.counts.push(row);
      $("sky").append(row);
    }
    $("sky").hidden = false;
  }
  function showSky(row) {
    sky.shown = row;
    const count = sky.ways.map(() => 0), marks = [];
    for (let k = sky.first[row]; k < sky.first[row + 1]; k++) {
      const way = sky.way[k], colour = sky.ways[way][1], name = sky.names[sky.name[k]];
      const x = sky.place[2 * k], y = -sky.place[2 * k + 1];
      count[way]++;
      marks.push(mark("circle", { cx: x, cy: y, r: 4, stroke: colour, fill: way < 2 ? colour : "none" }), mark("text", { x, y: y + 9 }, name));
    }
    sky.marks.replaceChildren(...marks);
    sky.counts.forEach((line, way) => { line.textContent = `${count[way]} ${sky.ways[way][0]}`; });
  }

  const end = meta.end_s;
  let now = 0, playing = false, follow = Boolean(ego), last = 0, wanted = true;
  $("bar").hidden = !ego;
  $("slider").max = end;

  const place = new THREE.Vector3(), moved = new THREE.Vector3(), turn = new THREE.Quaternion();
  const matrix = new THREE.Matrix4(), scale = new THREE.Vector3(), other = new THREE.Quaternion();
  const up = new THREE.Vector3(0, 0, 1);

  const yaw = q => Math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z));

  function show(t) {
    now = t;
    if (ego) {
      const [a, b, f] = between(ego.time, t);
      const at = (row, k) => ego.position[3 * row + k];
      moved.set(...[0, 1, 2].map(k => at(a, k) + f * (at(b, k) - at(a, k))));
      const before = yaw(turn);
      turn.fromArray(ego.quat, 4 * a).slerp(other.fromArray(ego.quat, 4 * b), f);
      car.position.copy(moved);
      car.quaternion.copy(turn);
      if (follow) {
        for (const point of [camera.position, controls.target]) {
          point.sub(place).applyAxisAngle(up, yaw(turn) - before).add(moved);
        }
        controls.update();
      }
      place.copy(moved);
    }
    if (boxes) {
      const [a, b, f] = between(boxes.time, t);
      for (let k = 0; k < boxes.count; k++) {
        const i = 4 * (a * boxes.count + k), j = 4 * (b * boxes.count + k), p = boxes.pose;
        let swing = p[j + 3] - p[i + 3];
        swing -= 2 * Math.PI * Math.round(swing / (2 * Math.PI));
        moved.set(p[i] + f * (p[j] - p[i]), p[i + 1] + f * (p[j + 1] - p[i + 1]), p[i + 2] + f * (p[j + 2] - p[i + 2]));
        scale.fromArray(boxes.size, 3 * k);
        other.setFromAxisAngle(up, p[i + 3] + f * swing);
        boxes.mesh.setMatrixAt(k, matrix.compose(moved, other, scale));
      }
      boxes.mesh.instanceMatrix.needsUpdate = true;
    }
    if (cloud) {
      const row = lastBefore(cloud.time, t), first = Math.max(row + 1 - Number($("trail").value), 0);
      cloud.points.geometry.setDrawRange(cloud.first[first], cloud.first[row + 1] - cloud.first[first]);
    }
    if (pictures) {
      const row = Math.max(lastBefore(pictures.time, t), 0);
      if (row !== pictures.shown) {
        pictures.shown = row;
        const old = image.src;
        image.src = URL.createObjectURL(new Blob([bytes.subarray(pictures.first[row], pictures.first[row + 1])], { type: "image/jpeg" }));
        if (old) URL.revokeObjectURL(old);
      }
    }
    if (sky) {
      const row = Math.max(lastBefore(sky.time, t), 0);
      if (row !== sky.shown) showSky(row);
    }
    $("slider").value = t;
    $("time").textContent = `${t.toFixed(1)} / ${end.toFixed(1)} s`;
    wanted = true;
  }

  function look(above) {
    if (ego) {
      controls.target.copy(place).add(moved.set(8, 0, 1.2).applyQuaternion(turn));
      camera.position.copy(place).add(above ? moved.set(-1, 0, 110) : moved.set(-17, 0, 9).applyQuaternion(turn));
    } else {
      const [x, y, reach] = meta.centre;
      controls.target.set(x, y, 0);
      camera.position.set(x, y - (above ? 1 : 0.7 * reach), above ? 1.3 * reach : 0.55 * reach);
    }
    $("above").setAttribute("aria-pressed", above);
    controls.update();
    wanted = true;
  }

  function play(on) {
    playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    last = 0;
  }
  $("play").onclick = () => { if (!playing && now >= end) show(0); play(!playing); };
  $("slider").oninput = () => { play(false); show(Number($("slider").value)); };
  $("trail").onchange = () => show(now);
  $("town").onchange = () => { town.visible = $("town").checked; wanted = true; };
  $("follow").onclick = () => { follow = !follow; $("follow").setAttribute("aria-pressed", follow); };
  $("above").onclick = () => look($("above").getAttribute("aria-pressed") !== "true");
  onkeydown = event => {
    if (event.target.matches("input, select, button")) return;
    if (event.key === " ") $("play").click();
    if (event.key === "ArrowRight" || event.key === "ArrowLeft") {
      show(Math.min(Math.max(now + (event.key === "ArrowRight" ? 0.5 : -0.5), 0), end));
    }
  };
  controls.addEventListener("change", () => { wanted = true; });
  function resize() {
    renderer.setSize(innerWidth, innerHeight, false);
    camera.aspect = innerWidth / innerHeight;
    camera.updateProjectionMatrix();
    wanted = true;
  }
  addEventListener("resize", resize);

  resize();
  show(meta.opens_s);
  look(!ego && innerWidth < 700);
  function frame(ms) {
    requestAnimationFrame(frame);
    if (playing) {
      const t = now + (last ? (ms - last) / 1000 : 0);
      last = ms;
      show(Math.min(t, end));
      if (t >= end) play(false);
    }
    if (!wanted) return;
    wanted = false;
    renderer.render(scene, camera);
  }
  requestAnimationFrame(frame);
  // For tests: the state of the page, and a picture of it.
  window.page = {
    show, look, play, camera, place, boxes, drawn: () => renderer.info.render.triangles + renderer.info.render.points,
    render: () => renderer.render(scene, camera),
  };
}

say("loading …");
if (!document.createElement("canvas").getContext("webgl2")) say("This page needs a browser with WebGL 2.");
else unpack().then(buffer => { say(""); start(buffer); }).catch(error => { say(`The page is damaged: ${error.message}`); throw error; });
