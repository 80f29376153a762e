//! The detector node: YOLOv10 end-to-end over ONNX Runtime or rten.
