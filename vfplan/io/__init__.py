"""Files and what carries them: whole files or none, and h5py without plugins."""
