"""Live: ticks from a controller or a result, shown in 3D Slicer and kept as MCAP.

A leaf room: no other package imports it. Its command is `vfplan live`.

wire     the controller's datagrams
sources  ticks from a result, at its own pace, or from a port
feed     ticks at the rate of a display
igtl     OpenIGTLink messages
server   one OpenIGTLink server, any number of clients
web      the page's server, by WebSocket
page     the page to watch
"""
