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
#ifdef LEVEL
    // Asphalt bears a few bright stones and drops of tar in every square metre, and here and there a stain.
    float small = noise(p * 14.0 + 4.7);
    float large = noise(p * 4.3 + 9.1);
    float spots = (2.8 * smoothstep(0.945, 0.97, small) - 0.72 * smoothstep(0.075, 0.045, small)) * band(footprint, 14.0)
        + (0.5 * smoothstep(0.955, 0.97, large) - 0.55 * smoothstep(0.055, 0.04, large)) * band(footprint, 4.3);
    float porous = v_surface.y * v_surface.y * v_surface.y;
    albedo *= 1.0 + max(spots, -0.8) * porous * smoothstep(0.90, 0.97, v_normal.z);
#endif
    vec3 n = normalize(v_normal);
    // Leaves let half of the light through, and throw it to their neighbours: both sides are lit alike.
    bool leaf = v_layer == float(LEAF);
    albedo *= leaf ? 1.35 : 1.0;
    n = gl_FrontFacing || leaf ? n : -n;
    n = leaf ? normalize(0.45 * n + vec3(0.0, 0.0, 0.6)) : n;
    o_albedo = vec4(sqrt(clamp(albedo, 0.0, 1.0)), 1.0);
    o_normal = encode_normal(n);
    o_surface = vec4(texel.a, v_surface.yzw);
    o_id = v_id ^ SKY_ID;
    o_depth = 1.0 / gl_FragCoord.w;
}
