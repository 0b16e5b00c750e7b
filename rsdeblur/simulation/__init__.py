"""The forward model, which shares no code with `motion` and `psf`, with a test scene and a hand's shake."""
