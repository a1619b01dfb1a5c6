// Fog between the camera and a point, and the way from exposed radiance to the picture.
uniform vec3 u_eye;
uniform vec3 u_fog_light;   // exposed radiance of endless fog
uniform vec4 u_air;         // fog extinction at height 0 [1/m], 1/scale height [1/m], start [m], uniform extinction [1/m]
uniform uint u_dither;

// Share of the light that passes a ray of unit direction from the eye; Koschmieder's law with a fog
// that thins exponentially with height, whose integral is closed.
float transmittance(vec3 direction, float length_m) {
    float path = max(length_m - u_air.z, 0.0);
    float z = u_eye.z + direction.z * min(u_air.z, length_m);
    float k = path * direction.z * u_air.y;
    float safe = abs(k) < 1e-3 ? 1.0 : k;
    float mean = abs(k) < 1e-3 ? 1.0 - 0.5 * k : (1.0 - exp(-safe)) / safe;
    float depth = u_air.x * exp(-max(z, -50.0) * u_air.y) * path * min(mean, 60.0) + u_air.w * path;
    return exp(-depth);
}

// The sky's own colour holds the haze already; rain, dust and haze veil it as 400 m of air would.
vec3 sky_through_air(vec3 light, vec3 direction) {
    vec4 air = u_air;
    float high = 1.0 / (u_air.y * max(direction.z, 0.004));
    float fog = air.x * exp(-max(u_eye.z, -50.0) * air.y) * high;
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

#ifdef NIGHT
uniform vec2 u_electrons;   // of a pixel at value 1; noise of reading it [electrons]

// Few photons make a picture by night: their noise, as a sum of two even ones, and that of reading.
vec3 grainy(vec3 exposed) {
    uint h = mix_bits(uint(gl_FragCoord.x) * 40503u + uint(gl_FragCoord.y) * 65599u ^ u_dither);
    uint k = mix_bits(h + 0x9e3779b9u);
    vec3 a = vec3(float(h & 1023u), float((h >> 10) & 1023u), float((h >> 20) & 1023u));
    vec3 b = vec3(float(k & 1023u), float((k >> 10) & 1023u), float((k >> 20) & 1023u));
    vec3 lot = (a + b) * (2.4495 / 1024.0) - 2.4471;
    return exposed + lot * sqrt(max(exposed, 0.0) * u_electrons.x + u_electrons.y * u_electrons.y) / u_electrons.x;
}
#endif

vec4 develop(vec3 exposed) {
#ifdef LINEAR
    return vec4(exposed, 1.0);
#else
#ifdef NIGHT
    exposed = grainy(exposed);
#endif
    // As in rain_layer.py: linear up to 0.6, a soft shoulder above; then exact sRGB and half a step of dither.
    vec3 x = max(exposed, 0.0);
    vec3 toned = min(x, 0.6) + 0.4 * (1.0 - exp(-max(x - 0.6, 0.0) * 2.5));
    vec3 code = mix(1.055 * pow(toned, vec3(1.0 / 2.4)) - 0.055, 12.92 * toned, lessThan(toned, vec3(0.0031308)));
    uint h = mix_bits(uint(gl_FragCoord.x) + uint(gl_FragCoord.y) * 65536u ^ u_dither);
    vec3 grain = vec3(float(h & 1023u), float((h >> 10) & 1023u), float((h >> 20) & 1023u)) / 1024.0 - 0.4995;
    return vec4(code + grain / 255.0, 1.0);
#endif
}
