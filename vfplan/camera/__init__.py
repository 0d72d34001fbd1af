"""The wall in a camera's picture: a printed sheet with tags, the camera's pose, and the overlay.

sheet     the plan at true scale with its tags, the board of a calibration, and tags on a bone
pose      the camera, where it stands, and how far off what is drawn may be
overlay   line, bands, outline and tool on a frame, or why nothing is drawn; the page of the frames

A leaf room: no other package imports it. Its command is `vfplan ar`.
"""

# How far off the drawn line may be unless the caller says otherwise [mm]: half of a pen's line,
# beside which the wall would else seem to stand.
LIMIT_MM = 0.5

# Name of an output -> the codec of its video; others are pictures.
CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
