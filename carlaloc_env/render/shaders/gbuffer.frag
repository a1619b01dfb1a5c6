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

const float LITTER_M = 0.8;

layout(location = 0) out vec4 o_albedo;   // square root of the linear albedo; 1 = covered
layout(location = 1) out vec2 o_normal;   // octahedral, world
layout(location = 2) out vec4 o_surface;
layout(location = 3) out uint o_id;       // tag << 24 | instance, xor the sky's, so that a cleared texel is sky
layout(location = 4) out float o_depth;   // planar [m]

#ifdef LEVEL
// Share of a pixel that spans `width` about `at` which lies within `half_size` of zero.
float cover(float at, float width, float half_size) {
    return clamp((min(at + 0.5 * width, half_size) - max(at - 0.5 * width, -half_size)) / width, 0.0, 1.0);
}

// What lies about on streets, one thing in every cell of LITTER_M: pebbles, paper, leaves and surveyors' marks
// on asphalt and grass, gum and drops of oil on pavements.
vec3 litter(vec3 albedo, vec2 p, float amount) {
    vec2 cell = floor(p / LITTER_M);
    uint h = mix_bits(uint(int(cell.x)) * 0x9e3779b1u ^ uint(int(cell.y)) * 0x85ebca77u);
    vec2 at = (cell + 0.22 + 0.56 / 255.0 * vec2(h & 255u, (h >> 8) & 255u)) * LITTER_M;
    float angle = float((h >> 16) & 15u) * 0.393;
    float size = float((h >> 20) & 127u) / 127.0;
    vec2 along = vec2(cos(angle), sin(angle)), q = p - at, dx = dFdx(p), dy = dFdy(p);
    vec2 across = vec2(-along.y, along.x);
    uint kind = h >> 27;
    bool slabs = v_surface.y > 0.65 && v_surface.y < 0.85;
    vec2 half_m = kind == 0u && v_surface.y > 0.9 ? vec2(0.14, 0.02) : (0.008 + 0.042 * size * size) * vec2(1.0, 0.7);
    float share = cover(dot(q, along), abs(dot(along, dx)) + abs(dot(along, dy)), half_m.x)
        * cover(dot(q, across), abs(dot(across, dx)) + abs(dot(across, dy)), half_m.y);
    vec3 thing = kind > 24u ? vec3(0.34, 0.23, 0.10) : vec3(0.52, 0.51, 0.48);
    return mix(albedo, slabs ? vec3(0.045) : thing, share * amount);
}
#endif

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
    // Asphalt bears a few bright stones and drops of tar in every square metre.
    float small = noise(p * 14.0 + 4.7);
    float spots = (2.8 * smoothstep(0.945, 0.97, small) - 0.72 * smoothstep(0.075, 0.045, small)) * band(footprint, 14.0);
    float porous = v_surface.y * v_surface.y * v_surface.y;
    float level = smoothstep(0.90, 0.97, v_normal.z);
    albedo *= 1.0 + max(spots, -0.8) * porous * level;
    albedo = litter(albedo, p, level * step(0.25, v_surface.y));
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
