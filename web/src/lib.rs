//! The sensor and the unwrapping for a page that runs in a browser: a picture as radiance ([`picture`]), its exposure and recovery
//! ([`capture`]), and what the page shows of them ([`shown`]). [`boundary`] is what the page calls. The functions are those of
//! `modulo simulate`, and so are the results.

mod boundary;
mod capture;
mod picture;
mod shown;
