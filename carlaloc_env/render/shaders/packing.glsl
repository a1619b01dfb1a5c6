// Encodings and hashes that several passes share.

// Octahedral unit vectors (Cigolle et al., JCGT 3(2) 2014), 0..1 per channel.
vec2 encode_normal(vec3 n) {
    vec2 p = n.xy * (1.0 / (abs(n.x) + abs(n.y) + abs(n.z)));
    vec2 s = vec2(p.x >= 0.0 ? 1.0 : -1.0, p.y >= 0.0 ? 1.0 : -1.0);
    p = n.z < 0.0 ? (1.0 - abs(p.yx)) * s : p;
    return p * 0.5 + 0.5;
}

vec3 decode_normal(vec2 code) {
    vec2 p = code * 2.0 - 1.0;
    vec3 n = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    float t = max(-n.z, 0.0);
    n.xy -= vec2(n.x >= 0.0 ? t : -t, n.y >= 0.0 ? t : -t);
    return normalize(n);
}

uint mix_bits(uint x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

float lattice(ivec2 cell) {
    uint h = uint(cell.x) * 0x9e3779b1u ^ uint(cell.y) * 0x85ebca77u;
    h ^= h >> 15;
    h *= 0x2c1b3c6du;
    h ^= h >> 13;
    return float(h >> 8) * (1.0 / 16777216.0);
}

// Value noise 0..1 with cells of size 1.
float noise(vec2 p) {
    vec2 base = floor(p);
    vec2 f = p - base;
    f = f * f * (3.0 - 2.0 * f);
    ivec2 i = ivec2(base);
    float low = mix(lattice(i), lattice(i + ivec2(1, 0)), f.x);
    float high = mix(lattice(i + ivec2(0, 1)), lattice(i + ivec2(1, 1)), f.x);
    return mix(low, high, f.y);
}

// Weight that fades a pattern of `frequency` per metre out before it aliases.
float band(float footprint, float frequency) {
    return clamp(1.6 - 2.0 * footprint * frequency, 0.0, 1.0);
}

// Variation of the reflectance within metres, as far as it is seen; `scene/mottle.py` has all of it for LiDARs.
float mottled(vec2 p, float footprint) {
    const vec3 f = MOTTLE_CYCLES_PER_M;
    vec3 seen = vec3(band(footprint, f.x), band(footprint, f.y), band(footprint, f.z));
    vec3 layers = vec3(noise(p * f.x), noise(p * f.y), noise(p * f.z)) - 0.5;
    return dot(MOTTLE_SEEN * MOTTLE_GAINS * seen, layers);
}
