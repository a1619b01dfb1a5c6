// 2x2 samples per pixel to one: a 3x3 tent round the centred sample, by four bilinear fetches.
uniform vec2 u_size;           // of the picture [px]
uniform sampler2D u_albedo;
uniform sampler2D u_normal;
uniform sampler2D u_surface;
uniform sampler2D u_depth;
in vec3 v_ray;
layout(location = 0) out vec4 o_albedo;
layout(location = 1) out vec2 o_normal;
layout(location = 2) out vec4 o_surface;
layout(location = 3) out float o_depth;

vec4 tent(sampler2D source, vec2 uv, vec2 half_texel) {
    return 0.25 * (texture(source, uv - half_texel) + texture(source, uv + half_texel)
        + texture(source, uv + vec2(half_texel.x, -half_texel.y))
        + texture(source, uv + vec2(-half_texel.x, half_texel.y)));
}

void main() {
    vec2 texel = 0.5 / u_size;
    // Sample 2i of the fine grid lies on the centre of pixel i.
    vec2 uv = (2.0 * floor(gl_FragCoord.xy) + 0.5) * texel;
    vec2 half_texel = 0.5 * texel;
    o_albedo = tent(u_albedo, uv, half_texel);
    float share = 1.0 / max(o_albedo.a, 1e-3);
    o_normal = tent(u_normal, uv, half_texel).xy * share;
    o_surface = tent(u_surface, uv, half_texel) * share;
    o_depth = tent(u_depth, uv, half_texel).x * share;
}
