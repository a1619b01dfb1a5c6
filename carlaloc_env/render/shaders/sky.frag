#include "air.glsl"
#include "sky.glsl"
in vec3 v_ray;
layout(location = 0) out vec4 o_colour;

void main() {
    vec3 direction = normalize(v_ray);
    // The air above is bounded by its scale height, so 20 km stands for infinity.
    o_colour = develop(through_air(textureLod(u_sky, sky_uv(direction), 0.0).rgb, direction, SKY_DISTANCE));
}
