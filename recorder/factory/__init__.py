"""The standard dataset: drives recorded, replayed and put together."""
