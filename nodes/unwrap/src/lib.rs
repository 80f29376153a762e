//! The unwrap node: modulo image in, recovered image out.
