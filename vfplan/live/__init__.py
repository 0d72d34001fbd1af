"""Live: ticks from a controller or a result, shown in 3D Slicer and kept as MCAP.

A leaf room: no other package imports it. Its command is `vfplan live`.

sources  ticks of a result at its own pace, or of a controller's datagrams; the rate of a display
igtl     OpenIGTLink messages
server   the OpenIGTLink server, for any number of clients
web      the page's server, by WebSocket
page     the page to watch
"""

from __future__ import annotations
