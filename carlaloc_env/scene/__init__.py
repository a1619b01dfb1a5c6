"""Parts of a scene: meshes, materials, semantic tags, lenses of traffic lights."""
