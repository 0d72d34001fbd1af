"""Planned slices as they come: PNG, JPEG, TIFF, BMP and DICOM -> `PlannedImage`."""
