"""Parts of the example of splats: what a `colmap` folder holds, and a fit in JAX."""
