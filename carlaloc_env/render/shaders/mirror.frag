// What wet level ground mirrors of the scene: a march along the mirrored ray through the depth picture.
#include "fog.glsl"
in vec3 v_ray;
uniform vec4 u_unproject;
uniform vec2 u_size;           // of the picture [px]
uniform mat3 u_rotation;
uniform sampler2D u_albedo;
uniform sampler2D u_normal;
uniform sampler2D u_surface;
uniform sampler2D u_depth;
uniform vec3 u_wall_light;     // exposed irradiance / pi of an upright surface, mean of all ways round
uniform float u_exposure;
uniform float u_ripples;       // time of the ripples, 0 without rain
layout(location = 0) out vec4 o_mirror;   // exposed light, share that hits the scene

float glare(float code) {
    return min((exp2(LOG_SCALE * code) - 1.0) * u_exposure, 2.0);
}

void main() {
    vec2 pixel = floor(gl_FragCoord.xy) * vec2(COLUMN_PX, ROW_PX) + vec2((COLUMN_PX - 1) / 2, (ROW_PX - 1) / 2);
    vec2 uv = (pixel + 0.5) / u_size;
    float depth = texture(u_depth, uv).x;
    float up = decode_normal(texture(u_normal, uv).xy).z;
    vec3 p = v_ray * depth;
    vec3 ray = normalize(v_ray) * vec3(1.0, 1.0, -1.0);
    // Waves of the water bend the mirrored ray up and down; the world holds them, not the screen. Grains of
    // the asphalt are finer than pixels: they smear what is seen, see shade.frag.
    vec2 ground = (p + u_eye).xy;
    ray.z = abs(ray.z) + (noise(ground * 9.0 + u_ripples * 7.0) - 0.5) * 0.02 * min(6.0 / max(depth, 1.0), 1.0);
    vec3 a = transpose(u_rotation) * p;
    vec3 b = transpose(u_rotation) * ray;
    float s = 0.5;
    float hit = 0.0;
    vec2 at = uv;
    for (int i = 0; i < 14; ++i) {
        vec3 q = a + b * s;
        vec2 place = ((q.xy / max(q.z, 0.1) - u_unproject.zw) / u_unproject.xy + 0.5) / u_size;
        float there = texture(u_depth, place).x;
        bool inside = q.z > 0.3 && all(lessThan(abs(place - 0.5), vec2(0.5)));
        bool behind = there > 0.0 && there < q.z && there > q.z - (0.8 + 0.35 * s);
        bool found = inside && behind && hit == 0.0;
        at = found ? place : at;
        hit = found ? s : hit;
        s *= 1.38;
    }
    // Where between the last two steps.
    float low = hit / 1.38, high = hit;
    for (int i = 0; i < 3; ++i) {
        float mid = 0.5 * (low + high);
        vec3 q = a + b * mid;
        vec2 place = ((q.xy / max(q.z, 0.1) - u_unproject.zw) / u_unproject.xy + 0.5) / u_size;
        float there = texture(u_depth, place).x;
        bool behind = there > 0.0 && there < q.z;
        at = behind && hit > 0.0 ? place : at;
        high = behind ? mid : high;
        low = behind ? low : mid;
    }
    vec4 base = texture(u_albedo, at);
    vec4 surface = texture(u_surface, at);
    vec3 albedo = base.rgb * base.rgb / max(base.a * base.a, 0.05);
    vec3 hue = albedo / max(max(albedo.r, max(albedo.g, albedo.b)), 0.01);
    vec3 exposed = albedo * u_wall_light * 0.7 + hue * glare(surface.z);
#ifdef NIGHT_GLOW
    exposed += (albedo.g < 0.2 * albedo.r ? hue : LAMP_COLOUR) * glare(surface.w);
#endif
    exposed = through_air(exposed, ray, hit);
    float level = smoothstep(0.90, 0.97, up) * float(depth > 0.0);
    o_mirror = vec4(exposed, 1.0) * (hit > 0.0 ? level : 0.0);
}
