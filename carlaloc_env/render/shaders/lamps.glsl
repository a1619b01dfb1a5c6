// Lights of a night and their lists by tile.
//
// Every list holds its lights themselves, and an image is read without the steps of a texture: each texel costs
// llvmpipe time. Its loops run what is inside once more before they leave by a test at their beginning, so they
// test at the end; an empty list has an entry of no light.
layout(rgba32f) readonly uniform image2D u_lists;   // four texels a light, see light_table.py
#ifdef LAMPS
flat in uvec2 v_lamps;   // first entry and end of this tile's lists
#endif
#ifdef BEAMS
flat in uvec2 v_beams;
#endif
#ifdef GLOWS
flat in uvec2 v_glows;
#endif

vec4 light_texel(uint i, int part) {
    return imageLoad(u_lists, ivec2(int(i % LIST_COLUMNS) * LIGHT_TEXELS + part, i / LIST_COLUMNS));
}

// Fades a light out at its range, so that none pops in; by the squared share of the range.
float window(float share2) {
    float w = max(1.0 - share2 * share2, 0.0);
    return w * w;
}

#ifdef GLOWS
// Angle 0…pi of a vector with a positive second part; off by 6e-4 at most (minimax polynomial of the arc
// tangent in 0…1). A driver asks of every least of two values whether one of them is no number.
float angle_of(float x, float y) {
    float wide = abs(x);
    bool steep = y > wide;
    float q = (steep ? wide : y) / max(steep ? y : wide, 1e-9);
    float q2 = q * q;
    float a = q * (0.995354 + q2 * (-0.288690 + q2 * 0.079340));
    a = steep ? 1.5707963 - a : a;
    return x < 0.0 ? 3.1415927 - a : a;
}

// Light of the lamps round here scattered once towards the eye along a ray, by one equi-angular sample
// (single scattering with an isotropic phase function; Sun et al. 2005).
vec3 lamp_glow(vec3 direction, float length_m) {
    float beta = u_air.w + u_air.x * exp(-max(u_eye.z, FOG_FLOOR_M) * u_air.y);
    // As in `through_air`, all air before its start is clear.
    float start = min(u_air.z, length_m);
    float path = length_m - start;
    vec3 sum = vec3(0.0);
    uint i = v_glows.x;
    do {
        vec4 place = light_texel(i, 0);
        vec3 lamp = place.xyz;
        vec3 axis = light_texel(i, 2).xyz;
        float t0 = dot(lamp, direction);
        float h2 = max(dot(lamp, lamp) - t0 * t0, 0.0);
        float per_h = inversesqrt(h2 + 0.09);
        float h = (h2 + 0.09) * per_h;
        float angle = angle_of(h * h + (start - t0) * (length_m - t0), h * path);
        float t = t0 < start ? start : t0;
        t = t > length_m ? length_m : t;
        vec3 nearest = direction * t - lamp;
        float r2 = max(dot(nearest, nearest), 0.0025);
        float per_r = inversesqrt(r2);
        float edge = clamp((dot(nearest, axis) * per_r + 0.1) * 1.8181818, 0.0, 1.0);
        float beam = 0.15 + 1.6 * edge * edge * (3.0 - 2.0 * edge);
        float fade = max(1.0 - h2 * place.w, 0.0);
        sum += light_texel(i, 1).rgb * (fade * fade * beam * angle * per_h * dimmed(beta * (t - start + r2 * per_r)));
    } while (++i < v_glows.y);
    return sum * (0.25 * beta);
}
#endif
