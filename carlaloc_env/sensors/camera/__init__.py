"""The camera: colour, depth, semantics, flow, normals, events."""
