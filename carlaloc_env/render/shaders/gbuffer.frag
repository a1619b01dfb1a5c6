#ifdef LEVEL
#define SHADE smooth
#else
#define SHADE flat
#endif
SHADE in vec3 v_colour;   // runs over level ground, where wheels leave soft tracks
flat in float v_layer;
flat in uint v_id;
flat in vec4 v_surface;  // roughness, porosity, light by day and night, light at night
in vec3 v_normal;
in vec2 v_uv;
#ifdef WORN
in vec3 v_world;
flat in vec4 v_blocks;   // columns and rows of a tile, offset of courses, frequency [1/m]
flat in vec3 v_variety;  // range of the blocks' tones; 1 = the texture's blocks are shuffled; mottle
#endif

uniform sampler2DArray u_textures;  // square root of the linear albedo, roughness

layout(location = 0) out vec4 o_albedo;   // square root of the linear albedo; 1 = covered
layout(location = 1) out vec2 o_normal;   // octahedral, world
layout(location = 2) out vec4 o_surface;
layout(location = 3) out uint o_id;       // tag << 24 | instance, xor the sky's, so that a cleared texel is sky
layout(location = 4) out float o_depth;   // planar [m]

uint mixed_cell(vec2 p, uint seed) {
    ivec2 cell = ivec2(floor(p));
    return mix_bits(uint(cell.x) * 0x9e3779b1u ^ uint(cell.y) * 0x85ebca77u ^ seed);
}

void main() {
#ifndef WORN
    // Behind each pane of a glass wall is a room of its own: any of the eight that the texture has.
    bool panes = v_layer == float(CURTAIN_WALL);
    uint room = mixed_cell(v_uv * vec2(4.0, 2.0), v_id);
    vec2 uv = v_uv + (panes ? vec2((uvec2(room) >> uvec2(0, 2)) & uvec2(3, 1)) * vec2(0.25, 0.5) : vec2(0.0));
    vec4 texel = textureGrad(u_textures, vec3(uv, v_layer), dFdx(v_uv), dFdy(v_uv));
#else
    // Dirt and wear at scales the repeating textures lack; none on paint, glass and metal.
    vec2 p = v_world.xy + v_world.z * MOTTLE_UP;
    float footprint = max(length(dFdx(p)), length(dFdy(p)));
    float patches = noise(p * MOTTLE_WEAR_PER_M + MOTTLE_WEAR_SHIFT) - 0.5;
    vec2 on_wall = vec2(v_normal.x * v_world.y - v_normal.y * v_world.x, v_world.z);
    vec2 q = abs(v_normal.z) < MOTTLE_STEEP ? on_wall : v_world.xy;
    vec2 right = dFdx(q), up = dFdy(q);
    vec2 along = dot(right, right) > dot(up, up) ? right : up;
    float across = abs(right.x * up.y - right.y * up.x) / max(length(along), 1e-6);
    float mottle = 1.0 + v_variety.z * mottled(q, along, across);
    float slow = noise(p * 0.13) - 0.5;
    float wear = slow * band(footprint, 0.13) + 0.8 * patches * band(footprint, 0.71);
    // Each slab, brick, stone, panel and board has its tone, since textures alone repeat after a tile.
    float offset = v_blocks.z * floor(v_uv.y * v_blocks.y);
    uint block = mixed_cell(v_uv * v_blocks.xy + vec2(offset, 0.0), v_id);
    uvec3 random = (uvec3(block) >> uvec3(8, 16, 24)) & 255u;
    float tone = v_variety.x * (random.z < 6u ? -1.2 : float(random.z) / 255.0 - 0.5) * band(footprint, v_blocks.w);
#ifndef LEVEL
    // In the place of each panel and board is any of those that the texture has.
    vec2 uv = v_uv + v_variety.y * (vec2(offset, 0.0) + floor(vec2(random) / 256.0 * v_blocks.xy)) / v_blocks.xy;
    // Field stones have no grid; here their pattern is drawn out, there pushed together.
    bool rubble = v_layer == float(RUBBLE);
    uv += rubble ? 0.06 * patches + vec2(0.5, 0.2) * slow : vec2(0.0);
    vec4 texel = textureGrad(u_textures, vec3(uv, v_layer), dFdx(v_uv), dFdy(v_uv));
#else
    vec4 texel = texture(u_textures, vec3(v_uv, v_layer));
#endif
#endif
    vec3 albedo = texel.rgb * texel.rgb * v_colour;
#ifdef WORN
#ifndef LEVEL
    albedo *= (1.0 + 0.45 * v_surface.y * wear) * (1.0 + tone) * mottle;
    // A field stone's roughness is a number of its own, which with the place gives its tone; mortar has none.
    float stone = texel.a - v_surface.x;
    float wave = 4.0 * abs(fract(4.0 * stone + 1.5 * patches + 3.0 * slow) - 0.5) - 1.0;
    albedo *= rubble ? 1.0 + 0.25 * min(40.0 * abs(stone), 1.0) * wave * band(footprint, 5.0) : 1.0;
#else
    float level = smoothstep(LEVEL_FROM, 0.97, v_normal.z);
    albedo *= (1.0 + mix(0.45, 0.20, level) * v_surface.y * wear) * (1.0 + level * tone) * mottle;
    // Lawns and fields dry out in places.
    vec3 straw = mix(vec3(0.92, 0.96, 0.95), vec3(1.22, 1.06, 1.05), clamp(0.5 + 1.1 * wear, 0.0, 1.0));
    albedo *= v_layer == float(GRASS) || v_layer == float(CROP) ? straw : vec3(1.0);
#endif
#endif
    vec3 n = normalize(v_normal);
#ifndef WORN
    // No two bays of a glass wall are furnished alike, nor do their panes stand quite in one plane.
    uint h = mixed_cell(v_uv, v_id);
    albedo *= panes ? 0.70 + 0.55 * float(h & 255u) / 255.0 : 1.0;
    n += panes ? 0.024 * (vec3((uvec3(h) >> uvec3(8, 16, 24)) & 255u) / 255.0 - 0.5) : vec3(0.0);
#endif
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
