"""G-buffer to light: sky, shadows, lamps, reflections, full-screen passes."""
