// The ray through the pixel, world axes, planar depth 1.
#ifdef TILES
uniform vec3 u_ray_first;   // through the upper left corner of the picture
uniform vec3 u_ray_right;   // and what it changes by a pixel to the right and down
uniform vec3 u_ray_down;
vec3 pixel_ray() {
    return u_ray_first + u_ray_right * gl_FragCoord.x + u_ray_down * gl_FragCoord.y;
}
#else
in vec3 v_ray;
vec3 pixel_ray() {
    return v_ray;
}
#endif
