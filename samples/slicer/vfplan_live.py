"""Show `vfplan live` in 3D Slicer: run inside Slicer, with the extension SlicerOpenIGTLink.

    Slicer --python-script vfplan_live.py

It connects to port 18944 of this machine, sets the look of the fixture and of the contact sphere,
and lets the sphere follow the proxy. The fixture arrives at once, the sphere and the proxy with the
first tick. Until then it looks again every half second.
"""

import slicer

PORT = 18944
RETRY_MS = 500

CLOUD_COLOUR = [0.18, 0.32, 0.91]
CLOUD_OPACITY = 1.0
CONTACT_COLOUR = [0.75, 0.0, 0.0]
CONTACT_OPACITY = 0.35


def connect(port=PORT):
    """Add a connector, which keeps trying to connect, and return it."""
    connector = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLIGTLConnectorNode", "vfplan")
    connector.SetTypeClient("localhost", port)
    connector.Start()
    return connector


def set_look(model, colour, opacity):
    """Set the colour and the opacity of a model."""
    model.CreateDefaultDisplayNodes()
    display = model.GetDisplayNode()
    display.SetColor(*colour)
    display.SetOpacity(opacity)
    display.SetPointSize(3)
    display.SetLineWidth(3)


def set_up_scene():
    """Set up what has arrived; returns whether all of it has."""
    cloud = slicer.mrmlScene.GetFirstNodeByName("vfplan_cloud")
    if cloud is None or not cloud.IsA("vtkMRMLModelNode"):
        return False
    set_look(cloud, CLOUD_COLOUR, CLOUD_OPACITY)

    contact = slicer.mrmlScene.GetFirstNodeByName("vfplan_contact")
    if contact is None or not contact.IsA("vtkMRMLModelNode"):
        return False
    set_look(contact, CONTACT_COLOUR, CONTACT_OPACITY)

    proxy = slicer.mrmlScene.GetFirstNodeByName("vfplan_proxy")
    if proxy is None:
        return False
    contact.SetAndObserveTransformNodeID(proxy.GetID())

    view = slicer.app.layoutManager().threeDWidget(0).threeDView()
    view.resetFocalPoint()
    return True


def set_up_when_complete():
    """Set up the scene, and look again later if something has not arrived yet."""
    import qt

    if not set_up_scene():
        qt.QTimer.singleShot(RETRY_MS, set_up_when_complete)


if __name__ == "__main__":
    connect()
    set_up_when_complete()
