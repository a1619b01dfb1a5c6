"""The OpenGL context, and how uniforms reach shaders."""
