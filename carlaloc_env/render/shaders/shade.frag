#include "fog.glsl"
#include "sky.glsl"
#include "ray.glsl"

uniform vec2 u_size;
uniform sampler2D u_albedo;
uniform sampler2D u_normal;
uniform sampler2D u_surface;
uniform sampler2D u_depth;
uniform vec3 u_ambient[9];     // exposed irradiance / pi as a polynomial in the normal
uniform vec3 u_ground;         // exposed radiance of the ground far away
uniform float u_exposure;
uniform sampler2D u_sheen;     // the sky for reflections: root of its light as a share of u_brightest
uniform float u_brightest;
uniform sampler2D u_roofs;     // blurred height of the highest surfaces [m]
uniform vec4 u_roofs_frame;    // its coordinates: xy * u_roofs_frame.xy + u_roofs_frame.zw, relative to the eye
#ifdef ACTORS
uniform sampler2DShadow u_shadow_actors;
uniform mat3 u_light_actors;   // world axes to coordinates 0..1 of the actors' map
uniform vec3 u_light_actors_eye;
#endif
#ifdef SUN
uniform sampler2DShadow u_shadow;
uniform mat3 u_light;          // the same for the static map
uniform vec3 u_light_eye;      // the eye in its coordinates
uniform vec3 u_sun;
uniform vec3 u_sun_light;      // exposed illuminance / pi
uniform float u_texel;         // of the static map [m]
uniform float u_shadow_step;   // of the static map, 1 = its edge
#endif
#ifdef WET
uniform vec2 u_wet;            // wetness 0..1, level of the puddles
uniform float u_ripples;       // time of the ripples, 0 without rain
uniform sampler2D u_mirror;    // what level ground mirrors of the scene, see mirror.frag
#endif
#ifdef SNOW
uniform sampler2D u_snow_map;  // distance from the nearest lane's middle, its height, that of the highest roof [m]
uniform vec4 u_snow_frame;     // its coordinates, as u_roofs_frame has them
uniform float u_snow_from;     // patches of level ground above it are covered
#endif
#ifdef BEAMS
// (1 - x²/32)^16, which is a normal curve but for its end and takes no exponential.
float bell(float h, float v, vec2 centre, vec2 per_width) {
    vec2 x = (vec2(h, v) - centre) * (per_width * 0.1767767);
    return sixteenth_power(max(1.0 - dot(x, x), 0.0));
}

// Intensity [cd] of a low beam for right-hand traffic; degrees right and up.
float low_beam(vec3 way) {
    float per_ahead = LOW_BEAM_DEGREES / max(way.x, LOW_BEAM_LEAST_AHEAD);
    float h = -way.y * per_ahead;
    float v = way.z * per_ahead;
    float cut = min(LOW_BEAM_CUT + max(h, 0.0) * LOW_BEAM_RISE, LOW_BEAM_END);
    float below = clamp(1.5 * (cut - v) + 0.5, 0.0, 1.0);
    below *= below * (3.0 - 2.0 * below);
    float beam = LOW_BEAM_NARROW_CD * bell(h, v, LOW_BEAM_NARROW_DEG, LOW_BEAM_NARROW_PER_DEG)
        + LOW_BEAM_WIDE_CD * bell(h, v, LOW_BEAM_WIDE_DEG, LOW_BEAM_WIDE_PER_DEG)
        + LOW_BEAM_FLOOR_CD * bell(h, v, LOW_BEAM_FLOOR_DEG, LOW_BEAM_FLOOR_PER_DEG);
    beam = below * beam + LOW_BEAM_HAZE_CD * bell(h, v, LOW_BEAM_HAZE_DEG, LOW_BEAM_HAZE_PER_DEG);
    return way.x > LOW_BEAM_LEAST_AHEAD ? beam : 0.0;
}
#endif

layout(location = 0) out vec4 o_colour;


// Exposed light of a lamp, cut where a picture would lose its colour.
float glare(float code) {
    return min((exp2(LOG_SCALE * code) - 1.0) * u_exposure, 2.0);
}

vec3 ambient(vec3 n) {
    return u_ambient[0] + u_ambient[1] * n.y + u_ambient[2] * n.z + u_ambient[3] * n.x
        + u_ambient[4] * (n.x * n.y) + u_ambient[5] * (n.y * n.z) + u_ambient[6] * (n.z * n.z)
        + u_ambient[7] * (n.x * n.z) + u_ambient[8] * (n.x * n.x - n.y * n.y);
}

float fifth(float x) {
    float square = x * x;
    return max(square * square * x, 0.0);
}

// What the reflection of lights takes from a surface.
struct Film {
    float alpha2;      // squared GGX roughness
    float visible;     // Karis' cheap visibility
    float f0;
    float edge;        // what is added where light grazes: rough surfaces shade themselves there (Lagarde 2011)
};

Film film(float alpha, float f0) {
    return Film(alpha * alpha, 0.5 + alpha, f0, max(1.0 - f0 - sqrt(alpha), 0.0));
}

// Microfacet reflection of one light, without the light: GGX, times pi, bent towards a limit that it never
// passes. Cosines between normal and light, normal and view, light and view. Fractions are multiplied out to a
// single one: divisions are what it costs.
float gloss(float nl, float nv, float lv, Film film, float limit) {
    float s = max(2.0 + 2.0 * lv, 0.01);    // squared length of the half vector
    float least = film.alpha2 * s;
    float d = (nl + nv) * (nl + nv) * (film.alpha2 - 1.0) + s;
    d = d > least ? d : least;
    float top = least * (film.f0 + film.edge * fifth(1.0 - 0.5 * sqrt(s)));
    return top * limit / (d * d * film.visible * limit + top);
}

#ifdef OVERCAST
#ifdef ACTORS
// Share of the overcast sky that cars and walkers leave: their outline from above, blurred.
float uncovered(vec3 offset, vec3 n) {
    vec3 a = u_light_actors * (offset + n * 0.15) + u_light_actors_eye;
    const float r = 0.0035;
#ifdef FEW_TAPS
    float lit = texture(u_shadow_actors, a);
#else
    float lit = (texture(u_shadow_actors, a + vec3(r, 0.3 * r, 0.0))
        + texture(u_shadow_actors, a + vec3(-0.75 * r, 0.7 * r, 0.0))
        + texture(u_shadow_actors, a + vec3(-0.25 * r, -r, 0.0))) * 0.3333333;
#endif
    return any(greaterThan(abs(a.xy - 0.5), vec2(0.495))) ? 1.0 : lit;
}
#else
float uncovered(vec3 offset, vec3 n) {
    return 1.0;
}
#endif
#endif

#ifdef SUN
float sunlit(vec3 offset, vec3 n) {
    vec3 p = offset + n * (1.5 * u_texel);
    vec3 s = u_light * p + u_light_eye;
    // Three bilinear taps blur the edge over three texels, about the sun's penumbra behind a house.
#ifdef FEW_TAPS
    float lit = texture(u_shadow, s);
#else
    float r = 0.95 * u_shadow_step;
    float lit = (texture(u_shadow, s + vec3(r, 0.3 * r, 0.0)) + texture(u_shadow, s + vec3(-0.75 * r, 0.7 * r, 0.0))
        + texture(u_shadow, s + vec3(-0.25 * r, -r, 0.0))) * 0.3333333;
#endif
    bool outside = any(greaterThan(abs(s.xy - 0.5), vec2(0.4995)));
    lit = outside ? 1.0 : lit;
#ifdef ACTORS
    vec3 a = u_light_actors * p + u_light_actors_eye;
    float near = texture(u_shadow_actors, a);
    bool far = any(greaterThan(abs(a.xy - 0.5), vec2(0.499)));
    lit = min(lit, far ? 1.0 : near);
#endif
    return lit;
}
#endif

void main() {
    vec2 uv = gl_FragCoord.xy / u_size;
    vec4 base = texture(u_albedo, uv);
    vec3 n = decode_normal(texture(u_normal, uv).xy);
    vec4 surface = texture(u_surface, uv);
    float depth = texture(u_depth, uv).x;
#ifdef RESOLVED
    float cover = base.a;
    base.rgb /= max(cover, 0.05);
    depth = depth <= 0.0 ? 100.0 : depth;
#else
    const float cover = 1.0;
#endif
    vec3 albedo = base.rgb * base.rgb;
    float roughness = surface.x;
    vec3 offset = pixel_ray() * depth;
    float length2 = dot(offset, offset);
    float per_length = inversesqrt(length2);
    float length_m = length2 * per_length;
    vec3 direction = offset * per_length;
    vec3 v = -direction;
    float f0 = 0.04;
    // Double panes throw back four times as much of the sky as one face; water is as smooth, but lies level.
    float panes = 0.12 * smoothstep(0.095, 0.07, roughness) * smoothstep(0.9, 0.7, abs(n.z));

    float brightest = max(albedo.r, max(albedo.g, max(albedo.b, 0.02)));
    vec3 emitted = albedo * (1.0 / brightest);
#ifdef NIGHT
    // Lamps that burn at night: warm white, or the colour of a red glass.
    vec3 hue = albedo.g < 0.2 * albedo.r ? emitted : LAMP_COLOUR * (0.4 + 0.6 * min(albedo.g * 4.0, 1.0));
    emitted = emitted * glare(surface.z) + hue * glare(surface.w);
#else
    emitted *= glare(surface.z);
#endif

#ifdef WET
    float soak = u_wet.x * surface.y;
    float grey = dot(albedo, vec3(0.3, 0.6, 0.1));
    albedo *= mix(1.0, mix(1.0, 0.35, surface.y), u_wet.x);
    // Bright grains stand out of the film, dark gaps are full of it.
    roughness = mix(roughness, 0.20 + 1.3 * min(grey, 0.25), soak);
    vec2 ground = (u_eye + offset).xy;
    float footprint = length_m * length_m * 0.0011;
    float hollow = 0.56 * noise(ground * 0.17) + 0.29 * noise(ground * 0.71 + 5.1)
        + 0.15 * mix(0.5, noise(ground * 3.1), band(footprint, 3.1));
    float water = smoothstep(u_wet.y, u_wet.y + 0.045, hollow)
        * smoothstep(0.93, 0.97, n.z) * smoothstep(0.5, 0.7, surface.y);
    albedo *= 1.0 - 0.45 * water;
    roughness = mix(roughness, 0.06, water);
    n = mix(n, vec3(0.0, 0.0, 1.0), water);
    f0 = mix(f0, 0.02, water);
    // Grains on the film, rings of drops on puddles.
    float grain = (noise(ground * 41.0 + u_ripples * 9.0 * water) - 0.5) * band(footprint, 41.0);
    n = normalize(n - vec3(direction.xy * (grain * mix(0.22 * soak, 0.05 * min(u_ripples, 1.0), water)), 0.0));
#endif

#ifdef SNOW
    vec3 place = u_eye + offset;
    vec3 above_lane = texture(u_snow_map, offset.xy * u_snow_frame.xy + u_snow_frame.zw).xyz;
    float spread_m = length_m * length_m * 0.0011;
    vec2 lumps = (vec2(noise(place.xy * 2.7), noise(place.xy * 2.7 + 31.7)) - 0.5) * band(spread_m, 2.7);
    float fine = (noise(place.xy * 15.0) - 0.5) * band(spread_m, 15.0);
    float narrow = (noise(place.xy * PATCH_FINE.x + PATCH_FINE.y) - 0.5) * band(spread_m, PATCH_FINE.x) + 0.5;
    float patches = mix(narrow, noise(place.xy * PATCH_COARSE.x), PATCH_COARSE.y);
    // Leaves carry heaps. Paint and glass are of things that move: a pattern of the world would slide on them.
    bool leaf = abs(surface.y - 0.1) < 0.02 && roughness > 0.9;
    float still = smoothstep(0.0, 0.05, surface.y);
    float heap = noise(place.xy * 2.3 + place.z * vec2(1.7, -2.1));
    float lies = leaf ? smoothstep(0.42, 0.60, heap + 1.2 * (n.z - 0.96))
        : smoothstep(0.45, 0.75, n.z + 0.25 * still * lumps.x);
    lies *= smoothstep(u_snow_from - 0.04, u_snow_from + 0.04, mix(0.5, patches, still));
    lies *= smoothstep(2.5, 1.2, above_lane.z - place.z) * smoothstep(0.082, 0.095, roughness);
    // Wheels clear two tracks in each lane and leave slush round them; ploughs heap a bank beside the road.
    float lane = abs(place.z - above_lane.y) < 0.4 ? above_lane.x : 9.0;
    float ragged = 0.25 * lumps.x + 0.3 * (patches - 0.5);
    float bare = smoothstep(TRACK_HALF_M + 0.12, TRACK_HALF_M - 0.10, abs(lane - TRACK_M) + ragged + 0.25 * fine) * 0.93;
    float driven = smoothstep(1.75, 1.35, lane + 0.3 * lumps.y);
    float bank = smoothstep(1.8, 2.1, lane) * smoothstep(3.0, 2.5, lane);
    float slush = clamp(0.75 * driven + 0.5 * bank * (0.5 + lumps.y), 0.0, 1.0);
    vec3 snow = mix(SNOW_WHITE, SNOW_SLUSH, slush) * (1.0 + 0.10 * fine + 0.05 * lumps.y);
    // The road between is wet, and its paint is dirty.
    float wet = lies * bare;
    albedo = mix(albedo, min(0.6 * albedo, vec3(0.16)), wet);
    roughness = mix(roughness, 0.4, 0.8 * wet);
    lies *= 1.0 - bare;
    albedo = mix(albedo, snow, lies);
    roughness = mix(roughness, 0.95, lies);
    n = normalize(n + vec3(lumps * (lies * still * (0.04 + 0.5 * bank + 0.08 * driven)), 0.0));
#endif

    // What lies below its surroundings sees less of the sky: foot of walls, courts, underpasses.
    float below = texture(u_roofs, offset.xy * u_roofs_frame.xy + u_roofs_frame.zw).x - u_eye.z - offset.z;
#ifdef SUN
    // Sunlit walls and roads throw light into it.
    float open = 0.58 + 0.42 * dimmed(0.22 * max(below, 0.0));
#else
    float open = 0.35 + 0.65 * dimmed(0.22 * max(below, 0.0));
#endif
#ifdef OVERCAST
    open *= 0.35 + 0.65 * uncovered(offset, n);
#endif
    vec3 light = ambient(n) * open;
    float alpha = max(roughness * roughness, 0.004);
    vec3 shine = vec3(0.0);
    float nv = max(dot(n, v), 0.0);
#ifdef SUN
    float facing = max(dot(n, u_sun), 0.0);
    vec3 sun = u_sun_light * facing * sunlit(offset, n);
    light += sun;
    shine += sun * gloss(facing, nv, dot(u_sun, v), film(max(alpha, 0.02), f0), 40.0);
#endif
#ifdef LAMPS
    Film lamp_film = film(max(alpha, 0.01), f0);
    uint i = v_lamps.x;
    do {
        vec4 place = light_texel(i, 0);
        vec4 colour_gain = light_texel(i, 1);
        vec4 axis_end = light_texel(i, 2);
        vec3 to = place.xyz - offset;
        float near2 = max(dot(to, to), LAMP_LEAST_M2);
        float per_r = inversesqrt(near2);
        vec3 l = to * per_r;
        float nl = max(dot(n, l), 0.0);
        float cosine = -dot(l, axis_end.xyz);
        float edge = clamp((cosine - axis_end.w) * light_texel(i, 3).w, 0.0, 1.0);
        // Batwing of a full cut-off luminaire; plain lamps have no gain.
        float gain = 1.0 / (cosine * cosine * cosine + 1e-3);
        float beam = (gain < colour_gain.w ? gain : colour_gain.w) * edge * edge * (3.0 - 2.0 * edge);
        vec3 e = colour_gain.rgb * (window(near2 * place.w) * beam * nl * per_r * per_r);
        light += e;
        shine += e * gloss(nl, nv, dot(l, v), lamp_film, 40.0);
    } while (++i < v_lamps.y);
#endif
#ifdef BEAMS
    // Rough surfaces throw light back to where it came from, most when it grazes them (Oren and Nayar
    // 1994): dry asphalt 0.008 cd/m2 per lx across the beam, which EN 1436 puts at about 0.01.
    float thrown_back = RETROREFLECTION * roughness * roughness / (roughness * roughness + 0.09);
    Film beam_film = film(max(alpha, 0.02), f0);
    uint j = v_beams.x;
    do {
        vec4 place = light_texel(j, 0);
        vec3 axis = light_texel(j, 2).xyz;
        vec3 left = light_texel(j, 3).xyz;
        vec3 way = offset - place.xyz;
        float near2 = max(dot(way, way), 1.0);
        float per_r = inversesqrt(near2);
        vec3 l = -way * per_r;
        float nl = max(dot(n, l), 0.0);
        vec3 turned = vec3(dot(axis, way), dot(left, way), dot(cross(axis, left), way));
        vec3 e = light_texel(j, 1).rgb * (low_beam(turned) * window(near2 * place.w) * nl * per_r * per_r);
        float lv = dot(l, v);
        light += e * (1.0 + thrown_back * max(lv - nl * nv, 0.0) / max(max(nl, nv), 0.01));
        shine += e * gloss(nl, nv, lv, beam_film, 5.0);
    } while (++j < v_beams.y);
#endif

    float smooth_part = (1.0 - roughness) * (1.0 - roughness);
    float fresnel = (f0 + panes) * (1.0 - roughness) + smooth_part * fifth(1.0 - nv);
    vec3 mirror = reflect(direction, n);
    vec3 root = textureLod(u_sheen, sky_uv(mirror), roughness * 6.0).rgb;
    vec3 above = root * root * u_brightest;
    // Walls across the street stand before the lowest part of the sky.
    vec3 reflection = mix(u_ground, above, smoothstep(-0.05, 0.30, mirror.z)) * open;
#ifdef MIRROR
    // Level by the width of what grains mirror from: a third of the picture's pixels at level 0.
    vec4 seen = textureLod(u_mirror, uv, MIRROR_SMEAR * roughness);
    reflection = reflection * (1.0 - seen.a) + seen.rgb;
#endif

    vec3 exposed = albedo * light + shine + reflection * fresnel + emitted;
    exposed = through_air(exposed, direction, length_m);
#ifdef GLOWS
    vec3 glow = lamp_glow(direction, cover < 0.5 ? GLOW_SKY_M : length_m);
#endif
#ifdef RESOLVED
    vec3 sky = sky_through_air(textureLod(u_sky, sky_uv(direction), 0.0).rgb, direction);
    exposed = mix(sky, exposed, cover);
#endif
#ifdef GLOWS
    // The air before the sky glows as that before surfaces does.
    exposed += glow;
#endif
    o_colour = develop(exposed);
}
