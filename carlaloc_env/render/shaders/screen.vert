// One triangle over the whole picture at the far plane, or points as large as its tiles over some of them.
uniform vec4 u_unproject;   // ray.xy = u_unproject.xy * pixel + u_unproject.zw
uniform vec2 u_size;
uniform mat3 u_rotation;    // camera to world
#ifdef TILES
in uvec2 in_cell;          // column and row
uniform float u_tile;       // edge [px]
#ifdef LAMPS
in uvec2 in_lamps;          // lists of lights, see lamps.glsl
flat out uvec2 v_lamps;
#endif
#ifdef GLOWS
in uvec2 in_glows;
flat out uvec2 v_glows;
#endif
#ifdef BEAMS
in uvec2 in_beams;
flat out uvec2 v_beams;
#endif
#endif

#ifndef TILES
out vec3 v_ray;             // through the pixel, world axes, planar depth 1
#endif

void main() {
#ifdef TILES
#ifdef LAMPS
    v_lamps = in_lamps;
#endif
#ifdef GLOWS
    v_glows = in_glows;
#endif
#ifdef BEAMS
    v_beams = in_beams;
#endif
    // Two triangles would shade what lies on their diagonal twice. The viewport is as large as whole tiles:
    // points whose middles lie outside are not drawn.
    vec2 corner = (vec2(in_cell) + 0.5) / ceil(u_size / u_tile) * 2.0 - 1.0;
    gl_PointSize = u_tile;
#else
    vec2 corner = vec2(float((gl_VertexID & 1) << 2) - 1.0, float((gl_VertexID & 2) << 1) - 1.0);
    vec2 pixel = (corner * 0.5 + 0.5) * u_size - 0.5;
    v_ray = u_rotation * vec3(u_unproject.xy * pixel + u_unproject.zw, 1.0);
#endif
    gl_Position = vec4(corner, 1.0, 1.0);
}
