//! `Image` <-> `Frame`.

use modulo_core::{Frame, FrameError, Mosaic, Samples};
use modulo_msgs::cdr;
use modulo_msgs::image::{ImageMessageError, encode_frame};
use modulo_msgs::sensor_msgs::Image;
use modulo_msgs::std_msgs::Header;
use ndarray::Array3;
use proptest::prelude::*;

fn header() -> Header {
    Header { frame_id: "camera".into(), ..Default::default() }
}

fn frames() -> impl Strategy<Value = Frame> {
    (1..6_usize, 1..6_usize, prop_oneof![Just(1_usize), Just(3)], 0..3, any::<u64>()).prop_map(
        |(height, width, channels, depth, seed)| {
            let value = |(i, j, c): (usize, usize, usize)| {
                ((seed >> (c * 8)) as usize).wrapping_add(i * 7919 + j * 31 * 257 + c) as u16
            };
            let dim = (height, width, channels);
            let frame = match depth {
                0 => Frame::from_u8(Array3::from_shape_fn(dim, |at| value(at) as u8)),
                1 => Frame::from_u16(Array3::from_shape_fn(dim, value)),
                _ => Frame::from_f32(Array3::from_shape_fn(dim, |at| f32::from(value(at)) / -3.0)),
            };
            let frame = frame.expect("a frame");
            let mosaics: Vec<Mosaic> = Mosaic::WORDS.into_iter().filter_map(|(_, mosaic)| mosaic).collect();
            match (frame.depth(), channels, height.min(width)) {
                (8 | 16, 1, 2..) if seed % 2 == 1 => {
                    frame.with_mosaic(mosaics[(seed >> 32) as usize % mosaics.len()]).expect("large enough")
                }
                _ => frame,
            }
        },
    )
}

/// Encodings with the positions of red, green and blue (or the one channel) in a pixel of so many samples.
fn written_as(frame: &Frame) -> &'static [(&'static str, &'static [usize], usize)] {
    match (frame.mosaic(), frame.depth()) {
        (None, _) => {}
        (Some(Mosaic::Rggb), 8) => return &[("bayer_rggb8", &[0], 1)],
        (Some(Mosaic::Bggr), 8) => return &[("bayer_bggr8", &[0], 1)],
        (Some(Mosaic::Grbg), 8) => return &[("bayer_grbg8", &[0], 1)],
        (Some(Mosaic::Gbrg), 8) => return &[("bayer_gbrg8", &[0], 1)],
        (Some(Mosaic::Rggb), _) => return &[("bayer_rggb16", &[0], 1)],
        (Some(Mosaic::Bggr), _) => return &[("bayer_bggr16", &[0], 1)],
        (Some(Mosaic::Grbg), _) => return &[("bayer_grbg16", &[0], 1)],
        (Some(Mosaic::Gbrg), _) => return &[("bayer_gbrg16", &[0], 1)],
    }
    match (frame.depth(), frame.channels()) {
        (8, 1) => &[("mono8", &[0], 1), ("8UC1", &[0], 1)],
        (16, 1) => &[("mono16", &[0], 1), ("16UC1", &[0], 1)],
        (8, _) => &[
            ("rgb8", &[0, 1, 2], 3),
            ("bgr8", &[2, 1, 0], 3),
            ("8UC3", &[2, 1, 0], 3),
            ("rgba8", &[0, 1, 2], 4),
            ("bgra8", &[2, 1, 0], 4),
            ("8UC4", &[2, 1, 0], 4),
        ],
        (16, _) => &[
            ("rgb16", &[0, 1, 2], 3),
            ("bgr16", &[2, 1, 0], 3),
            ("16UC3", &[2, 1, 0], 3),
            ("rgba16", &[0, 1, 2], 4),
            ("bgra16", &[2, 1, 0], 4),
            ("16UC4", &[2, 1, 0], 4),
        ],
        (_, 1) => &[("32FC1", &[0], 1)],
        _ => &[("32FC3", &[2, 1, 0], 3)],
    }
}

/// Writes sample by sample into an image full of `0xa5`.
fn write(frame: &Frame, which: usize, padding: usize, extra: usize, is_bigendian: u8) -> Image {
    let (height, width, channels) = frame.dim();
    let (encoding, places, samples) = written_as(frame)[which % written_as(frame).len()];
    let bytes = usize::from(frame.depth() / 8);
    let step = width * samples * bytes + padding;
    let mut data = vec![0xa5; height * step + extra];
    for i in 0..height {
        for j in 0..width {
            for c in 0..channels {
                let at = i * step + (j * samples + places[c]) * bytes;
                let sample = &mut data[at..at + bytes];
                match frame.samples() {
                    Samples::U8(pixels) => sample.copy_from_slice(&[pixels[[i, j, c]]]),
                    Samples::U16(pixels) => sample.copy_from_slice(&pixels[[i, j, c]].to_le_bytes()),
                    Samples::F32(pixels) => sample.copy_from_slice(&pixels[[i, j, c]].to_le_bytes()),
                }
                if is_bigendian != 0 {
                    sample.reverse();
                }
            }
        }
    }
    Image {
        header: header(),
        height: height as u32,
        width: width as u32,
        encoding: encoding.into(),
        is_bigendian,
        step: step as u32,
        data,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn every_layout_is_read(
        frame in frames(), which in 0..60_usize, padding in 0..5_usize, extra in 0..3_usize, big in 0..2_u8,
    ) {
        let image = write(&frame, which, padding, extra, big);
        let encoding = image.encoding.clone();
        prop_assert_eq!(image.into_frame(), Ok(frame), "{}", encoding);
    }

    #[test]
    fn a_frame_returns(frame in frames()) {
        let bytes = encode_frame(&header(), &frame).expect("short");
        let image: Image = cdr::from_slice(&bytes).expect("an image");
        prop_assert_eq!(image.data.len(), (image.height * image.step) as usize);
        prop_assert_eq!(Ok(bytes), cdr::to_vec(&image));
        prop_assert_eq!(image.into_frame(), Ok(frame));
    }

    #[test]
    fn nothing_panics(
        height in 0..4_u32, width in prop_oneof![0..4_u32, Just(u32::MAX)],
        step in prop_oneof![0..20_u32, Just(u32::MAX)], bytes in 0..60_usize, which in 0..21_usize,
    ) {
        let encoding = ["rgb8", "bgr8", "mono8", "rgba8", "bgra8", "rgb16", "bgr16", "mono16", "8UC1", "8UC3",
            "16UC1", "16UC3", "32FC1", "32FC3", "bayer_rggb8", "bayer_gbrg16", "uyvy", "yuyv", "nv12", "nv21", "nv24"][which];
        let data = vec![1; bytes];
        let header = header();
        let image = Image { header, height, width, encoding: encoding.into(), is_bigendian: 1, step, data };
        if let Ok(frame) = image.into_frame() {
            prop_assert_eq!((frame.height(), frame.width()), (height as usize, width as usize));
        }
    }
}

#[test]
fn floats_are_written_blue_first_as_opencv_does() {
    let pixel = |values: Vec<f32>| {
        let pixels = Array3::from_shape_vec((1, 1, values.len()), values).expect("one pixel");
        let bytes = encode_frame(&header(), &Frame::from_f32(pixels).expect("a frame"));
        cdr::from_slice::<Image>(&bytes.expect("short")).expect("an image")
    };
    let (mono, colour) = (pixel(vec![-0.5]), pixel(vec![1.0, 65_536.0, 0.25]));
    assert_eq!((mono.encoding.as_str(), mono.step, &mono.data[..]), ("32FC1", 4, &[0, 0, 0, 0xbf][..]));
    let bytes = [0, 0, 0x80, 0x3e, 0, 0, 0x80, 0x47, 0, 0, 0x80, 0x3f];
    assert_eq!((colour.encoding.as_str(), colour.step, &colour.data[..]), ("32FC3", 12, &bytes[..]));
}

#[test]
fn a_packed_image_keeps_its_buffer() {
    for (encoding, width) in [("rgb8", 2), ("mono8", 6)] {
        let data = vec![3; 24];
        let before = data.as_ptr();
        let image =
            Image { height: 4, width, encoding: encoding.into(), step: 6, data, ..Default::default() };
        let frame = image.into_frame().expect("a frame");
        assert_eq!(frame.as_u8().expect("8 bits").as_ptr(), before, "{encoding}");
    }
}

#[test]
fn errors_name_the_numbers() {
    let good = Image {
        height: 2,
        width: 3,
        encoding: "rgb8".into(),
        step: 10,
        data: vec![0; 20],
        ..Default::default()
    };
    assert!(good.clone().into_frame().is_ok());
    let spoiled = |spoil: fn(&mut Image)| {
        let mut image = good.clone();
        spoil(&mut image);
        image.into_frame().expect_err("spoiled")
    };
    let unknown = spoiled(|image| image.encoding = "yuv411".into());
    assert!(unknown.to_string().contains("'yuv411'"), "{unknown}");
    assert!(unknown.to_string().contains("rgb8, bgr8, mono8"), "{unknown}");
    let short = spoiled(|image| image.step = 8).to_string();
    assert_eq!(short, "image step is 8 bytes, a row needs at least 9");
    let cut = spoiled(|image| image.data.truncate(19)).to_string();
    assert_eq!(cut, "image data has 19 bytes, 20 expected of its height, step and encoding");
    let empty = spoiled(|image| image.width = 0);
    assert_eq!(empty, ImageMessageError::Frame(FrameError::Empty(2, 0)));
    let data = [1.0, 2.0, 3.0, f32::NAN].iter().flat_map(|sample: &f32| sample.to_le_bytes()).collect();
    let floats = Image { height: 2, width: 2, encoding: "32FC1".into(), step: 8, data, ..Default::default() };
    let why = floats.into_frame().expect_err("a depth camera's NaN").to_string();
    assert!(why.contains("(row 1, column 1, channel 0) is NaN"), "{why}");
}
