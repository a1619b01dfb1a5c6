"""How walkers walk, cross and avoid vehicles."""
