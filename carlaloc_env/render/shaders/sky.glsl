// Sky map in hemi-octahedral layout; directions below the horizon read the horizon.
uniform sampler2D u_sky;

vec2 sky_uv(vec3 direction) {
    vec3 d = vec3(direction.xy, max(direction.z, 0.0));
    vec2 p = d.xy / (abs(d.x) + abs(d.y) + d.z + 1e-6);
    return vec2(p.x + p.y, p.x - p.y) * 0.5 + 0.5;
}
