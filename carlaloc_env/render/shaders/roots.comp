#version 430 core
// One mip level of a material: square roots of the linear albedo, in bytes.
layout(local_size_x = 8, local_size_y = 8) in;
layout(rgba8, binding = 0) writeonly uniform image2DArray u_roots;
layout(binding = 0) uniform sampler2DArray u_linear;
uniform int u_level;
uniform int u_layer;

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID);
    if (all(lessThan(at, imageSize(u_roots).xy))) {
        vec4 texel = texelFetch(u_linear, ivec3(at, 0), u_level);
        imageStore(u_roots, ivec3(at, u_layer), vec4(sqrt(clamp(texel.rgb, 0.0, 1.0)), texel.a));
    }
}
