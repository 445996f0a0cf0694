"""CBM, the engine: from three tracked points to a full-body performance. Arrays in, arrays out.

Importing the package costs nothing: heavy imports (onnxruntime, torch, bpy) happen inside the functions that need them.
"""

__version__ = "0.9.0"
