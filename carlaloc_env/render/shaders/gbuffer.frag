flat in vec3 v_colour;
flat in float v_layer;
flat in uint v_id;
flat in vec4 v_surface;  // roughness, porosity, light by day and night, light at night
in vec3 v_normal;
in vec2 v_uv;
#ifdef WORN
in vec3 v_world;
#endif

uniform sampler2DArray u_textures;  // square root of the linear albedo, roughness

const float LITTER_M = 0.64;

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

// What lies about on streets, one thing in every cell of LITTER_M: fallen leaves, drops of oil and tar, pebbles,
// paper and surveyors' marks on asphalt and grass, gum and darker leaves on pavements.
// All of it soaks water up.
void litter(inout vec3 albedo, inout float porosity, vec2 p, float amount, float many) {
    vec2 cell = floor(p / LITTER_M);
    uint h = mix_bits(uint(int(cell.x)) * 0x9e3779b1u ^ uint(int(cell.y)) * 0x85ebca77u);
    vec2 at = (cell + 0.22 + 0.56 / 255.0 * vec2(h & 255u, (h >> 8) & 255u)) * LITTER_M;
    float angle = float((h >> 16) & 15u) * 0.393;
    float size = float((h >> 20) & 127u) / 127.0;
    vec2 along = vec2(cos(angle), sin(angle)), q = p - at, dx = dFdx(p), dy = dFdy(p);
    vec2 across = vec2(-along.y, along.x);
    uint kind = h >> 27;
    bool slabs = v_surface.y > 0.65 && v_surface.y < 0.85;
    bool dark = kind > 24u;
    bool leaf = kind > 9u && !dark;
    float grown = dark ? 0.012 + 0.088 * size * size : leaf ? (0.04 + 0.06 * size) * many : 0.010 + 0.080 * size * size;
    vec2 half_m = kind == 0u && v_surface.y > 0.9 ? vec2(0.20, 0.025) : grown * vec2(1.0, 0.7);
    vec2 local = vec2(dot(q, along), dot(q, across));
    float width = abs(dot(along, dx)) + abs(dot(along, dy));
    // Drops are round, leaves drawn out to one end; where pixels are longer than them, their mean width remains.
    float t = clamp(local.x / half_m.x, -1.0, 1.0);
    float outline = (1.05 - t * t) * (leaf ? 1.0 - 0.5 * t : 1.0);
    outline = mix(0.72, outline, clamp(1.8 - width / half_m.x, 0.0, 1.0));
    half_m.y *= dark || leaf ? outline : 1.0;
    float share = cover(local.x, width, half_m.x)
        * cover(local.y, abs(dot(across, dx)) + abs(dot(across, dy)), half_m.y);
    float hue = float(h & 255u) / 255.0;
    vec3 thing = dark ? vec3(0.032, 0.030, 0.028)
        : leaf ? mix(vec3(0.40, 0.25, 0.11), vec3(0.76, 0.66, 0.30), hue) : vec3(0.70, 0.69, 0.66);
    thing *= slabs && !dark ? 0.12 : 1.0;
    // Fast traffic leaves one thing in eight.
    amount *= v_layer == float(SWEPT) && (h & 0xe0000u) != 0u ? 0.0 : 1.0;
    albedo = mix(albedo, thing, share * amount);
    porosity = mix(porosity, 1.0, share * amount);
}

// Slabs that were laid at other times than their neighbours; textures repeat after 24 of them.
float slab_tone(float amount) {
    vec2 g = v_uv * vec2(4.0, 6.0);
    float row = floor(g.y);
    float column = floor(g.x + 0.5 * mod(row, 2.0));
    uint h = mix_bits(uint(int(column)) * 0x9e3779b1u ^ uint(int(row)) * 0x85ebca77u) >> 24;
    float tone = h < 12u ? 0.45 : h < 40u ? 1.28 : 0.90 + float(h) * (0.16 / 255.0);
    return v_surface.y > 0.75 && v_surface.y < 0.85 ? mix(1.0, tone, amount) : 1.0;
}
#endif

void main() {
    vec4 texel = texture(u_textures, vec3(v_uv, v_layer));
    vec3 albedo = texel.rgb * texel.rgb * v_colour;
    float porosity = v_surface.y;
#ifdef WORN
    // Dirt and wear at scales the repeating textures lack; none on paint, glass and metal.
    vec2 p = v_world.xy + v_world.z * vec2(0.43, 0.61);
    float footprint = max(length(dFdx(p)), length(dFdy(p)));
    float patches = noise(p * 0.71 + 17.3);
    float wear = (noise(p * 0.13) - 0.5) * band(footprint, 0.13) + 0.8 * (patches - 0.5) * band(footprint, 0.71);
    albedo *= 1.0 + 0.45 * v_surface.y * wear;
#endif
#ifdef LEVEL
    // Asphalt bears a few bright stones and drops of tar in every square metre.
    float small = noise(p * 14.0 + 4.7);
    float spots = (3.6 * smoothstep(0.945, 0.97, small) - 0.72 * smoothstep(0.075, 0.045, small)) * band(footprint, 14.0);
    float porous = v_surface.y * v_surface.y * v_surface.y;
    float level = smoothstep(LEVEL_FROM, 0.97, v_normal.z);
    // Spilt oil and spilt cement, their edges ragged from the grain.
    float edge = patches + 0.12 * (small - 0.5);
    float spilt = (0.6 * smoothstep(0.20, 0.17, edge) - 0.5 * smoothstep(0.80, 0.83, edge)) * band(footprint, 1.4);
    albedo *= (1.0 + max(spots, -0.8) * porous * level) * (1.0 + spilt * v_surface.y * level);
    albedo *= slab_tone(band(footprint, 1.4) * level);
    // Wind sweeps leaves together.
    litter(albedo, porosity, p, level * step(0.25, v_surface.y), 0.5 + 0.9 * patches);
#endif
    vec3 n = normalize(v_normal);
    // Leaves let half of the light through, and throw it to their neighbours: both sides are lit alike.
    bool leaf = v_layer == float(LEAF);
    albedo *= leaf ? 1.35 : 1.0;
    n = gl_FrontFacing || leaf ? n : -n;
    n = leaf ? normalize(0.45 * n + vec3(0.0, 0.0, 0.6)) : n;
    o_albedo = vec4(sqrt(clamp(albedo, 0.0, 1.0)), 1.0);
    o_normal = encode_normal(n);
    o_surface = vec4(texel.a, porosity, v_surface.zw);
    o_id = v_id ^ SKY_ID;
    o_depth = 1.0 / gl_FragCoord.w;
}
