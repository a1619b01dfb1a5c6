"""Tables of poses as text: their columns, units and order, by what stands in them."""
