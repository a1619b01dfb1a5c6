"""An episode, a rig and conditions made into sequences."""
