flat in vec4 v_light;
in float v_depth;
in float v_across;
uniform sampler2D u_depth;
layout(location = 0) out vec4 o_light;   // premultiplied

void main() {
    float depth = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).x;
    float seen = depth == 0.0 || depth > v_depth ? 1.0 : 0.0;
    float a = clamp(v_light.a * seen * 1.5 * (1.0 - v_across * v_across), 0.0, 1.0);
    o_light = vec4(v_light.rgb * a, a);
}
