"""Live: ticks from a controller or a result, shown in 3D Slicer and kept as MCAP.

A leaf room: no other package imports it. Its command is `vfplan live`.

sources  ticks of a result at its own pace, or of a controller's datagrams; the rate of a display
server   OpenIGTLink for any number of clients, the page to watch, and a receiver of poses
"""
