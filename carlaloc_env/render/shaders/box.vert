// The faces of a box as one strip of 14 corners, without buffers.
uniform vec3 u_low;         // relative to the eye [m]
uniform vec3 u_high;
uniform mat3 u_rotation;
uniform vec4 u_clip;
uniform vec2 u_range;

void main() {
    int bit = 1 << gl_VertexID;
    vec3 side = vec3((0x287a & bit) != 0, (0x02af & bit) != 0, (0x31e3 & bit) != 0);
    vec3 p = u_rotation * mix(u_low, u_high, side);
    gl_Position = vec4(u_clip.xy * p.xy + u_clip.zw * p.z, u_range.x * p.z + u_range.y, p.z);
}
