"""The demo detector's network: one heat map of object centres at stride 4.

Plain convolutions only, so that every ONNX engine runs it alike. Batch
normalisation is folded into the convolutions on export.
"""
import torch
from torch import nn
from torch.nn import functional as F

CLASSES = ["car", "van", "truck", "pedestrian", "cyclist"]
STRIDE = 4
TOP = 100  # boxes out, always


class Conv(nn.Module):
    """Convolution, batch norm, ReLU."""

    def __init__(self, inner, outer, kernel=3, stride=1, act=True):
        super().__init__()
        self.conv = nn.Conv2d(inner, outer, kernel, stride, kernel // 2, bias=False)
        self.norm = nn.BatchNorm2d(outer)
        self.act = act

    def forward(self, x):
        x = self.norm(self.conv(x))
        return F.relu(x) if self.act else x


class Block(nn.Module):
    """Two convolutions beside a shortcut."""

    def __init__(self, width):
        super().__init__()
        self.first = Conv(width, width)
        self.second = Conv(width, width, act=False)

    def forward(self, x):
        return F.relu(x + self.second(self.first(x)))


class Detector(nn.Module):
    """[B,3,H,W] in [0,1] -> raw head [B,5+4,H/4,W/4].

    Channels: 5 class logits, then left, top, right, bottom distances from the
    cell's centre to the box's sides, as logarithms of stride units.
    """

    def __init__(self, widths=(16, 32, 56, 88, 112)):
        super().__init__()
        w0, w1, w2, w3, w4 = widths
        self.stem = nn.Sequential(Conv(3, w0, 3, 2), Conv(w0, w1, 3, 2))
        self.s4 = Block(w1)
        self.s8 = nn.Sequential(Conv(w1, w2, 3, 2), Block(w2), Block(w2))
        self.s16 = nn.Sequential(Conv(w2, w3, 3, 2), Block(w3), Block(w3))
        self.s32 = nn.Sequential(Conv(w3, w4, 3, 2), Block(w4))
        self.side16, self.up32 = Conv(w3, w3, 1), Conv(w4, w3, 1)
        self.side8, self.up16 = Conv(w2, w2, 1), Conv(w3, w2, 1)
        self.side4, self.up8 = Conv(w1, w1, 1), Conv(w2, w1, 1)
        self.merge16, self.merge8, self.merge4 = Conv(w3, w3), Conv(w2, w2), Conv(w1, 48)
        self.cls = nn.Sequential(Conv(48, 32), nn.Conv2d(32, len(CLASSES), 1))
        self.box = nn.Sequential(Conv(48, 32), nn.Conv2d(32, 4, 1))
        nn.init.constant_(self.cls[1].bias, -4.0)
        nn.init.constant_(self.box[1].bias, 0.7)

    def forward(self, x):
        up = lambda t: F.interpolate(t, scale_factor=2.0, mode="nearest")
        s4 = self.s4(self.stem(x))
        s8 = self.s8(s4)
        s16 = self.s16(s8)
        p16 = self.merge16(self.side16(s16) + up(self.up32(self.s32(s16))))
        p8 = self.merge8(self.side8(s8) + up(self.up16(p16)))
        p4 = self.merge4(self.side4(s4) + up(self.up8(p8)))
        return torch.cat([self.cls(p4), self.box(p4)], 1)


def distances(raw):
    """Box distances in pixels from the head's four box channels."""
    return torch.exp(raw.clamp(-4.0, 5.5)) * STRIDE


class EndToEnd(nn.Module):
    """[1,3,H,W] -> [1,100,6]: x1, y1, x2, y2, score, class; best first.

    A peak is a cell whose score is the largest of its class in its 3 x 3
    neighbourhood; no other suppression is needed.
    """

    def __init__(self, net):
        super().__init__()
        self.net = net

    def forward(self, images):
        raw = self.net(images)
        width = torch.as_tensor(raw.shape[3]).to(raw.dtype)
        score = torch.sigmoid(raw[:, :5])
        peak = F.max_pool2d(score, 3, 1, 1)
        score = score * (score >= peak).to(score.dtype)
        best, cls = score.max(1)
        spare = (0, TOP)  # so that an image of few cells has its TOP rows too
        values, cells = F.pad(best.reshape(1, -1), spare).topk(TOP, 1)
        kind = F.pad(cls.reshape(1, -1).to(score.dtype), spare).gather(1, cells)
        flat = F.pad(distances(raw[:, 5:]).reshape(1, 4, -1), spare)
        left, top, right, bottom = (flat[:, side].gather(1, cells) for side in range(4))
        cell = cells.to(score.dtype)
        row = torch.floor((cell + 0.5) / width)
        x = (cell - row * width + 0.5) * STRIDE
        y = (row + 0.5) * STRIDE
        return torch.stack([x - left, y - top, x + right, y + bottom, values, kind], 2)
