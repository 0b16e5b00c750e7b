"""Videos: every frame deblurred with its own exposure window (extra ``[video]``).

`clip` reads what a video is and its frames, `times` when each frame was exposed, `plan` looks over all frames once,
`segments` deblurs and encodes a few frames at a time, and `joining` puts the segments and the sound together.
"""
