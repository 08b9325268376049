"""The renderer of first-person worlds: a scene and a camera in, a picture out. No display, no OpenGL."""
