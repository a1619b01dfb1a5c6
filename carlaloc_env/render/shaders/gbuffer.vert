#ifdef LEVEL
#define SHADE smooth
#else
#define SHADE flat
#endif
in vec3 in_position;
in vec4 in_normal;
in vec2 in_uv;
in vec3 in_colour;
in uint in_material;
in uint in_id;
#ifdef INSTANCED
in vec4 in_row0;
in vec4 in_row1;
in vec4 in_row2;
in vec4 in_tint;
in uint in_instance;
#endif

uniform vec3 u_eye;
uniform mat3 u_rotation;
uniform vec4 u_clip;
uniform vec2 u_range;
uniform vec4 u_surface[MATERIALS];
#ifdef WORN
uniform vec4 u_blocks[MATERIALS];
uniform vec3 u_variety[MATERIALS];
#endif

#ifdef SWAY
uniform vec4 u_sway;        // farthest way of leaves to leeward [m] (3), time [s]
#endif

SHADE out vec3 v_colour;
flat out float v_layer;
flat out uint v_id;
flat out vec4 v_surface;
out vec3 v_normal;
out vec2 v_uv;
#ifdef WORN
out vec3 v_world;
flat out vec4 v_blocks;
flat out vec3 v_variety;
#endif

void main() {
    v_colour = in_colour;
    v_id = in_id;
#ifdef INSTANCED
    vec4 local = vec4(in_position, 1.0);
    vec3 world = vec3(dot(in_row0, local), dot(in_row1, local), dot(in_row2, local));
    v_normal = vec3(dot(in_row0.xyz, in_normal.xyz), dot(in_row1.xyz, in_normal.xyz),
                    dot(in_row2.xyz, in_normal.xyz));
    bool tinted = (in_material == CAR_PAINT || in_material == CLOTH)
        && min(in_colour.x, min(in_colour.y, in_colour.z)) > 0.998;
    v_colour = tinted ? in_tint.xyz : in_colour;
    v_id = (in_id & 0xff000000u) | (in_instance & 0x00ffffffu);
#else
    vec3 world = in_position;
    v_normal = in_normal.xyz;
#endif
#ifdef SWAY
    // Two slow waves run through the crowns; neighbouring leaves move together.
    float wave = 0.6 * sin(u_sway.w * 1.9 + dot(world, vec3(0.35, 0.27, 0.20)))
        + 0.4 * sin(u_sway.w * 4.7 + dot(world, vec3(1.1, 0.9, 0.7)));
    world += in_material == LEAF ? u_sway.xyz * wave : vec3(0.0);
#endif
#ifdef WORN
    v_world = UNIT_M * world;
    v_blocks = u_blocks[in_material];
    v_variety = u_variety[in_material];
#endif
    v_layer = float(in_material);
    v_uv = in_uv;
    v_surface = u_surface[in_material];
    v_surface.w = max(v_surface.w, in_normal.w);
    vec3 p = u_rotation * (world - u_eye);
    gl_Position = vec4(u_clip.xy * p.xy + u_clip.zw * p.z, u_range.x * p.z + u_range.y, p.z);
}
