//! What a camera on the moving base measures.
