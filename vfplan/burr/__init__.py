"""A fixture burred away under the tool; the demonstration of editing.

A leaf room: no other package imports it. Its command is `vfplan burr`.
"""
