"""What a hub for datasets asks for: card, Croissant, tables, shards."""
