"""Live: ticks from a controller or a result, shown in 3D Slicer and kept as MCAP.

wire     the controller's datagrams
sources  ticks from a result, at its own pace, or from a port
igtl     OpenIGTLink messages
server   one OpenIGTLink server, any number of clients
mcapfile every tick in an MCAP file, and back
"""
