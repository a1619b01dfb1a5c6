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

float lattice(uint h) {
    h ^= h >> 15;
    h *= 0x2c1b3c6du;
    h ^= h >> 13;
    return float(int(h >> 8)) * (1.0 / 16777216.0);  // signed: processors convert it at once
}

// Value noise 0..1 with cells of size 1.
float noise(vec2 p) {
    const uvec2 odd = uvec2(0x9e3779b1u, 0x85ebca77u);
    vec2 base = floor(p);
    vec2 f = p - base;
    f = f * f * (3.0 - 2.0 * f);
    // The product of the next cell is this one's and once more the number: sums are cheaper.
    uvec2 a = uvec2(ivec2(base)) * odd;
    uvec2 b = a + odd;
    float low = mix(lattice(a.x ^ a.y), lattice(b.x ^ a.y), f.x);
    float high = mix(lattice(a.x ^ b.y), lattice(b.x ^ b.y), f.x);
    return mix(low, high, f.y);
}

// Weight that fades a pattern of `frequency` per metre out before it aliases.
float band(float footprint, float frequency) {
    return clamp(1.6 - 2.0 * footprint * frequency, 0.0, 1.0);
}

#ifndef LEVEL
#undef MOST_PLACES
#define MOST_PLACES 1
#endif

// Variation of the reflectance within metres, as far as it is seen; `scene/mottle.py` has all of it for LiDARs.
// A pixel is a parallelogram, `along` its longer side and `across` the height over it [m].
float mottled(vec2 p, vec2 along, float across) {
    const vec3 f = MOTTLE_CYCLES_PER_M;
    const vec3 gains = MOTTLE_SEEN * MOTTLE_GAINS;
    float long_m = length(along);
#if MOST_PLACES == 1
    vec3 seen = vec3(band(long_m, f.x), band(long_m, f.y), band(long_m, f.z));
    return dot(gains * seen, vec3(noise(p * f.x), noise(p * f.y), noise(p * f.z)) - 0.5);
#else
    // Pixels look along the ground. In all but live pictures each has the mean of as many places as the pattern needs.
    float sum = 0.0;
    for (int k = 0; k < 3; k++) {
        float count = clamp(ceil(long_m * f[k] / 0.3), 1.0, float(MOST_PLACES));
        float share = gains[k] * band(max(across, long_m / count), f[k]) / count;
        vec2 way = f[k] * along / count;
        vec2 first = f[k] * p - 0.5 * (count - 1.0) * way;
        // A loop that does not turn takes no time, unlike a branch.
        count = share > 0.0 ? count : 0.0;
        for (float i = 0.0; i < count; i++) {
            sum += share * (noise(first + i * way) - 0.5);
        }
    }
    return sum;
#endif
}
