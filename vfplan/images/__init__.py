"""Planned slices from PNG, JPEG, TIFF, BMP and DICOM files, each read as a `PlannedImage`."""
