in vec3 in_position;
#ifdef NO_LEAVES
in uint in_material;
#endif
#ifdef INSTANCED
in vec4 in_row0;
in vec4 in_row1;
in vec4 in_row2;
#endif

uniform mat3 u_light;    // world axes to the light's axes, scaled to clip space
uniform vec3 u_origin;   // world point at the centre of the map [m]

void main() {
#ifdef INSTANCED
    vec4 local = vec4(in_position, 1.0);
    vec3 world = vec3(dot(in_row0, local), dot(in_row1, local), dot(in_row2, local));
#else
    vec3 world = in_position;
#endif
    gl_Position = vec4(u_light * (world - u_origin), 1.0);
#ifdef NO_LEAVES
    gl_Position = in_material == NO_LEAVES ? vec4(0.0, 0.0, 2.0, 1.0) : gl_Position;
#endif
}
