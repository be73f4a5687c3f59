"""The simulated ground: regions, orthophotos, texture, light."""
