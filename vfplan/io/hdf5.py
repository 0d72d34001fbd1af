"""h5py, imported with every HDF5 plugin switched off.

A plugin is code that libhdf5 loads from a folder named by the environment; "::" tells it to load
none. libhdf5 reads the variable once, when it starts, so it must be set before h5py is imported.
Whoever opens an HDF5 file, a bundle, a session or a result, takes h5py from here.
"""

from __future__ import annotations

import os

os.environ["HDF5_PLUGIN_PRELOAD"] = "::"

import h5py

# Had somebody imported h5py before, libhdf5 has its folders already: forget them.
while h5py.h5pl.size():
    h5py.h5pl.remove(0)
