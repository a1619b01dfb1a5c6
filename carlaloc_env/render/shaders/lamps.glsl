// Lights of a night and their lists by tile.
struct Lamp {
    vec4 place;    // relative to the eye [m], 1 / range² [1/m²]
    vec4 light;    // exposed intensity / pi, most gain towards the edge of the beam
    vec4 axis;     // middle of the beam, cosine at which it has ended
    vec4 left;     // to the left of a car, 1 / way of the cosine from the end to the full beam
    vec4 glow;     // exposed intensity / pi that lights the air, 1 / squared reach of the glow [1/m²]
};
layout(std140) uniform Lamps { Lamp lamps[MOST_LIGHTS]; };
layout(std140) uniform Lists { uvec4 lists[LIST_SIZE / 4]; };

#ifdef LAMPS
flat in uvec2 v_lamps;   // first entry and end of this tile's lists
#endif
#ifdef BEAMS
flat in uvec2 v_beams;
#endif
#ifdef GLOWS
flat in uvec2 v_glows;
#endif

uint entry(uint i) {
    return lists[i >> 2][i & 3u];
}

// How far the air glows before the sky [m].
const float SKY_M = 1000.0;

// Fades a light out at its range, so that none pops in; by the squared share of the range.
float window(float share2) {
    float w = max(1.0 - share2 * share2, 0.0);
    return w * w;
}

#ifdef GLOWS
// Angle 0…pi of a vector with a positive second part; off by 1e-4 at most (Abramowitz and Stegun 4.4.49).
float angle_of(float x, float y) {
    float least = min(abs(x), y);
    float q = least / max(max(abs(x), y), 1e-9);
    float q2 = q * q;
    float a = q * (0.9998660 + q2 * (-0.3302995 + q2 * (0.1801410 + q2 * (-0.0851330 + q2 * 0.0208351))));
    a = y > abs(x) ? 1.5707963 - a : a;
    return x < 0.0 ? 3.1415927 - a : a;
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
        float per_h = inversesqrt(h2 + 0.09);
        float h = (h2 + 0.09) * per_h;
        float angle = angle_of(h * h + t0 * t0 - t0 * length_m, h * length_m);
        float t = clamp(t0, 0.0, length_m);
        float beta = u_air.w + (t > u_air.z ? fog : 0.0);
        vec3 nearest = direction * t - lamp;
        float r2 = max(dot(nearest, nearest), 0.0025);
        float per_r = inversesqrt(r2);
        float edge = clamp((dot(nearest, lamps[k].axis.xyz) * per_r + 0.1) * 1.8181818, 0.0, 1.0);
        float beam = 0.15 + 1.6 * edge * edge * (3.0 - 2.0 * edge);
        float fade = max(1.0 - h2 * lamps[k].glow.w, 0.0);
        sum += lamps[k].glow.rgb * (fade * fade * beam * beta * angle * per_h * exp(-beta * (t + r2 * per_r)));
    }
    return sum * 0.25;
}
#endif
