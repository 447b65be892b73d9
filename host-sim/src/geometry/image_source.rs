//! image_source
