// Lights of a night and their lists by tile.
struct Lamp {
    vec4 place;    // relative to the eye [m], range [m]
    vec4 light;    // exposed intensity / pi, most gain towards the edge of the beam
    vec4 axis;     // middle of the beam, cosine at which it has ended
    vec4 left;     // to the left of a car, cosine at which it begins to end
    vec4 glow;     // exposed intensity / pi that lights the air, reach of the glow [m]
};
layout(std140) uniform Lamps { Lamp lamps[MOST_LIGHTS]; };
layout(std140) uniform Lists { uvec4 lists[LIST_SIZE / 4]; };

flat in uvec2 v_lamps;   // first entry and end of this tile's lists
flat in uvec2 v_beams;
flat in uvec2 v_glows;

uint entry(uint i) {
    return lists[i >> 2][i & 3u];
}

// How far the air glows before the sky [m].
const float SKY_M = 1000.0;

// Fades a light out at its range, so that none pops in.
float window(float r2, float range) {
    float x = r2 / (range * range);
    float w = max(1.0 - x * x, 0.0);
    return w * w;
}

// Light of the lamps round here scattered once towards the eye along a ray, by one equi-angular sample
// (single scattering with an isotropic phase function; Sun et al. 2005).
vec3 lamp_glow(vec3 direction, float length_m) {
    float fog = u_air.x * exp(-max(u_eye.z, -50.0) * u_air.y);
    vec3 sum = vec3(0.0);
    for (uint i = v_glows.x; i < v_glows.y; ++i) {
        uint k = entry(i);
        vec3 lamp = lamps[k].place.xyz;
        float t0 = dot(lamp, direction);
        float h2 = max(dot(lamp, lamp) - t0 * t0, 0.0);
        float h = sqrt(h2 + 0.09);
        float angle = atan(h * length_m, h * h + t0 * t0 - t0 * length_m);
        float t = clamp(t0, 0.0, length_m);
        float beta = u_air.w + (t > u_air.z ? fog : 0.0);
        vec3 nearest = direction * t - lamp;
        float r = length(nearest);
        float cosine = dot(nearest, lamps[k].axis.xyz) / max(r, 0.05);
        float beam = 0.15 + 1.6 * smoothstep(-0.1, 0.45, cosine);
        float fade = max(1.0 - h2 / (lamps[k].glow.w * lamps[k].glow.w), 0.0);
        sum += lamps[k].glow.rgb * (fade * fade * beam * beta * angle / h * exp(-beta * (t + r)));
    }
    return sum * 0.25;
}
