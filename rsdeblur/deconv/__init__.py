"""Deconvolution: transforms, tiles, Wiener filters, priors and the rowwise solve. No module here knows a gyro."""
