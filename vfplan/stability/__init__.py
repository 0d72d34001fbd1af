"""Does the loop stay stable when the wall is stiff, and does the engine stay passive?

>>> from vfplan.stability import study
>>> study.gate(fixture, robot)                     # the verdict; raises CheckFailed

`study.study` runs all parts: closed loop, passivity, extreme cases.
docs/stability.md has the derivations, the tables and the pictures.
"""
