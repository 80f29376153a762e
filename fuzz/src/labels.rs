//! Files of labels.

use modulo_bags::source::{
    CocoSource, GroundTruth, KittiSource, Source, YoloSource, from_detections, to_detections,
};

/// A PNG file of one grey pixel.
const PIXEL: &[u8] =
    b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0:~\x9bU\0\0\0\nIDATx\x9cch\0\0\0\x82\
    \0\x81w\xcdr\xb6\0\0\0\0IEND\xaeB`\x82";

/// KITTI's labels of an image, and of a drive.
pub fn kitti(data: &[u8]) {
    let folder = super::folder(&[
        ("image_2/0.png", PIXEL),
        ("label_2/0.txt", data),
        ("drives/image_02/7/0.png", PIXEL),
        ("drives/label_02/7.txt", data),
    ]);
    for path in [folder.path().to_owned(), folder.path().join("drives/image_02/7")] {
        if let Ok(mut source) = KittiSource::open(&path, 0.0) {
            all(&mut source);
        }
    }
}

/// COCO's annotations of the image `a.png`.
pub fn coco(data: &[u8]) {
    let folder = super::folder(&[("a.json", data), ("images/a.png", PIXEL)]);
    let images = folder.path().join("images");
    if let Ok(mut source) = CocoSource::open(&folder.path().join("a.json"), Some(&images)) {
        all(&mut source);
    }
}

/// YOLO's labels of an image, and the names of its classes, parted by a zero.
pub fn yolo(data: &[u8]) {
    let cut = data.iter().position(|&byte| byte == 0).unwrap_or(data.len());
    let (labels, names) = data.split_at(cut);
    let folder = super::folder(&[
        ("images/0.png", PIXEL),
        ("labels/0.txt", labels),
        ("data.yaml", names.get(1..).unwrap_or(b"names: []")),
    ]);
    if let Ok(mut source) = YoloSource::open(folder.path()) {
        all(&mut source);
    }
}

fn all(source: &mut dyn Source) {
    let mut read = 0;
    while let Some(frame) = source.next() {
        read += 1;
        if let Ok(Some(labels)) = frame.map(|frame| frame.ground_truth) {
            check(&labels);
        }
    }
    assert_eq!(source.len(), Some(read));
}

/// Boxes are finite and not inside out, and none is lost on the way through a message.
fn check(labels: &[GroundTruth]) {
    for GroundTruth { bbox, .. } in labels {
        assert!([bbox.x1, bbox.y1, bbox.x2, bbox.y2].iter().all(|v| v.is_finite()), "{bbox:?}");
        assert!(bbox.x1 <= bbox.x2 && bbox.y1 <= bbox.y2, "{bbox:?}");
    }
    let sent = from_detections(&to_detections(labels, &Default::default()));
    let classes = |labels: &[GroundTruth]| labels.iter().map(|label| label.class.clone()).collect::<Vec<_>>();
    assert_eq!(classes(&sent), classes(labels));
}
