"""From scene to image: frames, exposure, shutter, motion between frames."""
