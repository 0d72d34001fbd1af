"""What a DICOM file says: opened in one place for slices, drawings on slices, and surfaces."""
