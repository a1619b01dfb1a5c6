"""Parts of the example of splats: views of a `colmap` folder, and a fit in JAX."""
