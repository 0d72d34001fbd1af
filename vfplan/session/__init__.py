"""Recordings of HIP positions in, replay results out.

`read.read_session` gives a whole recording, `read.open_session` a stream of blocks that never holds
more than a few of them; `result.ResultWriter` writes a result as it comes.
"""
