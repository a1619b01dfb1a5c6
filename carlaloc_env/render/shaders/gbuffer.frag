flat in vec3 v_colour;
flat in float v_layer;
flat in uint v_id;
flat in vec4 v_surface;  // roughness, porosity, light by day and night, light at night
in vec3 v_normal;
in vec2 v_uv;
#ifdef WORN
in vec3 v_world;
#endif

uniform sampler2DArray u_textures;

layout(location = 0) out vec4 o_albedo;   // square root of the linear albedo; 1 = covered
layout(location = 1) out vec2 o_normal;   // octahedral, world
layout(location = 2) out vec4 o_surface;
layout(location = 3) out uint o_id;       // tag << 24 | instance, xor the sky's, so that a cleared texel is sky
layout(location = 4) out float o_depth;   // planar [m]

void main() {
    vec4 texel = texture(u_textures, vec3(v_uv, v_layer));
    vec3 albedo = texel.rgb * v_colour;
#ifdef WORN
    // Dirt and wear at scales the repeating textures lack; none on paint, glass and metal.
    vec2 p = v_world.xy + v_world.z * vec2(0.43, 0.61);
    float footprint = max(length(dFdx(p)), length(dFdy(p)));
    float wear = (noise(p * 0.13) - 0.5) * band(footprint, 0.13)
        + 0.8 * (noise(p * 0.71 + 17.3) - 0.5) * band(footprint, 0.71);
    albedo *= 1.0 + 0.45 * v_surface.y * wear;
#endif
    vec3 n = normalize(v_normal);
    n = gl_FrontFacing ? n : -n;
    o_albedo = vec4(sqrt(clamp(albedo, 0.0, 1.0)), 1.0);
    o_normal = encode_normal(n);
    o_surface = vec4(texel.a, v_surface.yzw);
    o_id = v_id ^ SKY_ID;
    o_depth = 1.0 / gl_FragCoord.w;
}
