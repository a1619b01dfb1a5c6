"""Pictures by OpenGL; imports neither PyBullet nor Open3D."""
