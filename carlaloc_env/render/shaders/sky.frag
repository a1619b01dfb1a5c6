#include "fog.glsl"
#include "sky.glsl"
#include "ray.glsl"
layout(location = 0) out vec4 o_colour;

void main() {
    vec3 direction = normalize(pixel_ray());
    vec3 exposed = sky_through_air(textureLod(u_sky, sky_uv(direction), 0.0).rgb, direction);
#ifdef GLOWS
    exposed += lamp_glow(direction, GLOW_SKY_M);
#endif
    o_colour = develop(exposed);
}
