"""What a scene is made of: meshes, materials, semantic tags, lenses of traffic lights."""
