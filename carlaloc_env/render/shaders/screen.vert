// One triangle over the whole picture at the far plane.
uniform vec4 u_unproject;   // ray.xy = u_unproject.xy * pixel + u_unproject.zw
uniform vec2 u_size;
uniform mat3 u_rotation;    // camera to world

out vec3 v_ray;             // through the pixel, world axes, planar depth 1

void main() {
    vec2 corner = vec2(float((gl_VertexID & 1) << 2) - 1.0, float((gl_VertexID & 2) << 1) - 1.0);
    vec2 pixel = (corner * 0.5 + 0.5) * u_size - 0.5;
    v_ray = u_rotation * vec3(u_unproject.xy * pixel + u_unproject.zw, 1.0);
    gl_Position = vec4(corner, 1.0, 1.0);
}
