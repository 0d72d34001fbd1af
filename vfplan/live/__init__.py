"""Live: ticks from a controller or a result, shown in 3D Slicer and kept as MCAP.

wire     the controller's datagrams
sources  ticks from a result, at its own pace, or from a port
feed     ticks at the rate of a display
igtl     OpenIGTLink messages
server   one OpenIGTLink server, any number of clients
web      a page to watch, by WebSocket
mcapfile every tick in an MCAP file, and back
"""
