"""Quantities estimated from the picture: noise, strengths, the clock offset, and whether to trust a result."""
