//! What the house keeps to: layers, sizes, metadata.
