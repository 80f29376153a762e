//! The modulo_camera node: a simulated modulo sensor over any source of frames.
