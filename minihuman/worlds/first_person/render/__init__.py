"""The renderer of first-person worlds, which turns a scene and a camera into a picture without a display or OpenGL."""
