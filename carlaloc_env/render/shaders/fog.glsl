// Fog between the camera and a point, and the way from exposed radiance to the picture.
uniform vec3 u_eye;
uniform vec3 u_fog_light;   // exposed radiance of endless fog
uniform vec4 u_air;         // fog extinction at height 0 [1/m], 1/scale height [1/m], start [m], uniform extinction [1/m]
uniform uint u_dither;

float sixteenth_power(float x) {
    x *= x;
    x *= x;
    x *= x;
    return x * x;
}

// exp(-x) of x from 0 on, off by x³/1536 of itself at most; an exponential costs twice as much.
float dimmed(float x) {
    float part = min(x * 0.0625, 1.0);
    return sixteenth_power(1.0 - part + 0.5 * part * part);
}

// Share of the light that passes a ray of unit direction from the eye; Koschmieder's law with a fog
// that thins exponentially with height, whose integral is closed.
float transmittance(vec3 direction, float length_m) {
    float path = max(length_m - u_air.z, 0.0);
    float z = u_eye.z + direction.z * min(u_air.z, length_m);
    float k = path * direction.z * u_air.y;
    float safe = abs(k) < 1e-3 ? 1.0 : k;
    float mean = abs(k) < 1e-3 ? 1.0 - 0.5 * k : (1.0 - exp(-safe)) / safe;
    float depth = u_air.x * exp(-max(z, FOG_FLOOR_M) * u_air.y) * path * min(mean, 60.0) + u_air.w * path;
    return exp(-depth);
}

// The sky's own colour holds the haze already; rain, dust and haze veil it as 400 m of air would.
vec3 sky_through_air(vec3 light, vec3 direction) {
    vec4 air = u_air;
    float high = 1.0 / (u_air.y * max(direction.z, 0.004));
    float fog = air.x * exp(-max(u_eye.z, FOG_FLOOR_M) * air.y) * high;
    float t = exp(-fog - air.w * 400.0);
    return light * t + u_fog_light * (1.0 - t);
}

vec3 through_air(vec3 light, vec3 direction, float length_m) {
    float t = transmittance(direction, length_m);
    return light * t + u_fog_light * (1.0 - t);
}

#ifdef TILES
#include "lamps.glsl"
#endif

uint pixel_key(int factor_x, int factor_y) {
    return uint(int(gl_FragCoord.x) * factor_x + int(gl_FragCoord.y) * factor_y) ^ u_dither;
}

// Three whole numbers below 1024 from the bits of one.
ivec3 thirds(uint h) {
    return ivec3(int(h & 1023u), int((h >> 10) & 1023u), int((h >> 20) & 1023u));
}

#ifdef NIGHT
uniform vec2 u_noise;   // variance of photon noise at value 1, and of reading a pixel

// Few photons make a picture by night: their noise, as a sum of two even ones, and that of reading.
vec3 grainy(vec3 exposed) {
    uint h = mix_bits(pixel_key(40503, 65599));
    vec3 lot = vec3(thirds(h) + thirds(mix_bits(h + 0x9e3779b9u))) * (2.4495 / 1024.0) - 2.4471;
    return exposed + lot * sqrt(max(exposed, 0.0) * u_noise.x + u_noise.y);
}
#endif

// Linear up to its shoulder, bent above; then sRGB and half a step of dither. Both parts of
// the curve are polynomials, of the fourth root below and of what the shoulder bends above, which are within
// 0.012 steps of the formulas; logarithms would wait for each other.
vec3 coded(vec3 exposed) {
    vec3 x = max(exposed, 0.0);
    vec3 low = min(x, TONE_SHOULDER);
    vec3 q = sqrt(sqrt(low));
    vec3 dark = (((0.10021731 * q - 0.37593190) * q + 1.15321771) * q + 0.18656585) * q - 0.06356571;
    dark = mix(dark, 12.92 * low, lessThan(low, vec3(0.0031308)));
    vec3 bent = 1.0 - exp2(min((TONE_SHOULDER - x) * TONE_PER_ROOM, 0.0));
    return dark + ((0.00828239 * bent - 0.04231894) * bent + 0.23632364) * bent;
}

vec4 develop(vec3 exposed) {
#ifdef LINEAR
    return vec4(exposed, 1.0);
#else
#ifdef NIGHT
    exposed = grainy(exposed);
#endif
    vec3 grain = vec3(thirds(mix_bits(pixel_key(1, 65536)))) * (1.0 / (1024.0 * 255.0)) - 0.4995 / 255.0;
    return vec4(coded(exposed) + grain, 1.0);
#endif
}
