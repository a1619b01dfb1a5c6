// One streak per instance: a thin quad along the way of a drop.
in vec3 in_end;             // relative to the eye [m]
in vec3 in_begin;
in vec4 in_light;           // exposed radiance, opacity
in float in_diameter;       // [m]
uniform mat3 u_rotation;    // world to camera
uniform vec4 u_clip;
uniform vec2 u_size;
uniform vec2 u_focal;       // [px]

flat out vec4 v_light;
out float v_depth;
out float v_across;

void main() {
    vec3 a = u_rotation * in_begin;
    vec3 b = u_rotation * in_end;
    a.z = max(a.z, 0.2);
    b.z = max(b.z, 0.2);
    vec2 from = u_clip.xy * a.xy / a.z + u_clip.zw;
    vec2 to = u_clip.xy * b.xy / b.z + u_clip.zw;
    vec2 along = (to - from) * u_size;
    vec2 aside = vec2(-along.y, along.x) / max(length(along), 1e-3);
    bool late = (gl_VertexID & 1) == 1;
    float side = (gl_VertexID & 2) == 2 ? 1.0 : -1.0;
    vec3 p = late ? b : a;
    // Never thinner than 0.8 px: thinner ones are paler instead, so that they do not twinkle.
    float wide = in_diameter * u_focal.x / p.z;
    float drawn = max(wide, 0.8);
    v_light = vec4(in_light.rgb, in_light.a * wide / drawn);
    v_depth = p.z;
    v_across = side;
    gl_Position = vec4((late ? to : from) + aside * (side * drawn) / u_size, 0.0, 1.0);
}
