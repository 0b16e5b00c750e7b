"""The evaluation of the published method, repeated: ``python -m benchmarks.paper``.

Sindelar and Sroubek, "Image deblurring in smartphone devices using built-in inertial measurement sensors", Journal of
Electronic Imaging 22(1), 011003, 2013, doi:10.1117/1.JEI.22.1.011003. Each module makes one group of figures; each
figure is a :class:`benchmarks.paper.figure.Figure`.
"""
