"""From a stack of outlined slices to a surface that a proxy can touch.

A leaf room: no other package imports it. Its command is `vfplan surface`.
"""
