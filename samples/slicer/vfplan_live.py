"""Show `vfplan live` in 3D Slicer: run inside Slicer, with the extension SlicerOpenIGTLink.

    Slicer --python-script vfplan_live.py            (port 18944 of this machine)

Connects, gives each device its look, and hangs the contact sphere on the proxy. What arrives before
the first tick is only the curve; the rest is set up when it comes.
"""

import slicer

PORT = 18944
LOOK = {  # device -> colour, opacity
    "vfplan_cloud": ((0.18, 0.32, 0.91), 1.0),
    "vfplan_contact": ((0.75, 0.0, 0.0), 0.35),
}


def connect(port=PORT):
    """A connector that keeps trying; returns it."""
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLIGTLConnectorNode", "vfplan")
    node.SetTypeClient("localhost", port)
    node.Start()
    return node


def dress():
    """Give what has arrived its look; true when all of it is there."""
    for name, (colour, opacity) in LOOK.items():
        model = slicer.mrmlScene.GetFirstNodeByName(name)
        if model is None or not model.IsA("vtkMRMLModelNode"):
            return False
        model.CreateDefaultDisplayNodes()
        display = model.GetDisplayNode()
        display.SetColor(*colour)
        display.SetOpacity(opacity)
        display.SetPointSize(3)
        display.SetLineWidth(3)
    proxy = slicer.mrmlScene.GetFirstNodeByName("vfplan_proxy")
    if proxy is None:
        return False
    contact = slicer.mrmlScene.GetFirstNodeByName("vfplan_contact")
    contact.SetAndObserveTransformNodeID(proxy.GetID())
    view = slicer.app.layoutManager().threeDWidget(0).threeDView()
    view.resetFocalPoint()
    return True


def wait():
    """Look again every half second until everything is there."""
    import qt

    if not dress():
        qt.QTimer.singleShot(500, wait)


if __name__ == "__main__":
    connect()
    wait()
