// Sky map in hemi-octahedral layout; directions below the horizon read the horizon.
uniform sampler2D u_sky;

vec2 sky_uv(vec3 direction) {
    vec3 d = vec3(direction.xy, max(direction.z, 0.0));
    float half_share = 0.5 / (abs(d.x) + abs(d.y) + d.z + 1e-6);
    return vec2(d.x + d.y, d.x - d.y) * half_share + 0.5;
}
