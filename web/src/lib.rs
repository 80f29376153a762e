//! The sensor, the unwrapping and the embedded detector for a page that runs in a browser: a picture as radiance ([`picture`]), its exposure and
//! recovery ([`capture`]), what the page shows of them ([`shown`]), and the boxes in it ([`boxes`]). [`boundary`] is what the page calls. The
//! functions are those of `modulo simulate` and of the detector node, and so are the results.

mod boundary;
mod boxes;
mod capture;
mod picture;
mod shown;
