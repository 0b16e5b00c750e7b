"""The published method's evaluation, run again: ``python -m benchmarks.paper``.

Sindelar and Sroubek, "Image deblurring in smartphone devices using built-in inertial measurement sensors", Journal of
Electronic Imaging 22(1), 2013. One module per group of figures; each is a
:class:`benchmarks.paper.figure.Figure`.
"""
