//! Images with luma and chroma against OpenCV.

use modulo_msgs::sensor_msgs::Image;
use proptest::prelude::*;

/// Written by `tests/peers/yuv_reference.py`.
const GOLDEN: &str = include_str!("../data/yuv_golden.txt");

fn bytes(hex: &str) -> Vec<u8> {
    let digits = hex.as_bytes().as_chunks().0.iter();
    let byte = |pair: &[u8; 2]| u8::from_str_radix(std::str::from_utf8(pair).expect("ASCII"), 16);
    digits.map(|pair| byte(pair).expect("hexadecimal digits")).collect()
}

/// Images with their pixels as RGB.
fn golden() -> Vec<(Image, Vec<u8>)> {
    let line = |line: &str| {
        let [encoding, height, width, step, data, rgb] =
            line.split(' ').collect::<Vec<_>>().try_into().expect("six words");
        let [height, width, step] = [height, width, step].map(|word: &str| word.parse().expect("a number"));
        let (encoding, data) = (encoding.to_owned(), bytes(data));
        (Image { encoding, height, width, step, data, ..Image::default() }, bytes(rgb))
    };
    GOLDEN.lines().map(line).collect()
}

#[test]
fn luma_and_chroma_become_what_opencv_makes_of_them() {
    let golden = golden();
    assert_eq!(golden.len(), 10);
    for (image, rgb) in golden {
        let older = match image.encoding.as_str() {
            "uyvy" => "yuv422",
            "yuyv" => "yuv422_yuy2",
            same => same,
        };
        // Bytes have no order.
        let older = Image { encoding: older.into(), is_bigendian: 1, ..image.clone() };
        for image in [image, older] {
            let frame = image.clone().into_frame().expect("readable");
            let expected = (image.height as usize, image.width as usize, 3);
            assert_eq!((frame.dim(), frame.mosaic()), (expected, None), "{}", image.encoding);
            let pixels = frame.as_u8().expect("8 bits").as_slice().expect("standard layout");
            assert_eq!(pixels, rgb, "{} with a step of {}", image.encoding, image.step);
        }
    }
}

#[test]
fn pixels_without_chroma_and_missing_bytes_are_refused() {
    for (image, _) in golden() {
        let Image { height, width, step, ref data, .. } = image;
        let short = Image { data: data[..data.len() - 1].to_vec(), ..image.clone() };
        let why = short.into_frame().expect_err("short").to_string();
        let expected = format!("data has {} bytes, {} expected", data.len() - 1, data.len());
        assert!(why.contains(&expected), "{}: {why}", image.encoding);
        let row = if image.encoding.starts_with("nv") { width } else { 2 * width };
        let narrow = Image { step: row - 1, ..image.clone() };
        let why = narrow.into_frame().expect_err("narrow").to_string();
        assert!(why.contains(&format!("step is {} bytes, a row needs at least {row}", row - 1)), "{why}");
        for (height, width, is_read) in [
            (height, width - 1, image.encoding == "nv24"),
            (height - 1, width, !matches!(image.encoding.as_str(), "nv12" | "nv21")),
        ] {
            let odd = Image { height, width, step, ..image.clone() }.into_frame();
            assert_eq!(odd.is_ok(), is_read, "{} {width} x {height}", image.encoding);
            if let Err(why) = odd {
                let (why, size) = (why.to_string(), format!("{width} x {height} px"));
                assert!(why.contains(&size) && why.contains("multiples of 2"), "{why}");
            }
        }
    }
}

proptest! {
    /// Whatever the sizes say: an image has its pixels, or is refused with a sentence.
    #[test]
    fn any_sizes_are_read_or_refused(
        height in prop_oneof![0..5_u32, Just(u32::MAX - 1)], width in prop_oneof![0..5_u32, Just(u32::MAX - 1)],
        step in prop_oneof![0..12_u32, Just(u32::MAX)], bytes in 0..80_usize, which in 0..5_usize,
    ) {
        let encoding = ["uyvy", "yuyv", "nv12", "nv21", "nv24"][which].into();
        let image = Image { height, width, step, encoding, data: vec![128; bytes], ..Image::default() };
        match image.into_frame() {
            // Grey without chroma: 1.164 (128 - 16).
            Ok(frame) => prop_assert!(frame.as_u8().expect("8 bits").iter().all(|&sample| sample == 130)),
            Err(why) => prop_assert!(why.to_string().starts_with("image "), "{why}"),
        }
    }
}
