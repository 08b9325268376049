"""Odd in what render returns."""

import numpy as np

from tests.worlds.odd.plain import Plain, odd


@odd(r"render\(\) returned float32 values from .* which are shown as black")
class PictureFloat01(Plain):
    def render(self):
        return (super().render() / 255).astype(np.float32)


@odd(noticed=r"its picture is of float64; fractions are cut off")
class PictureFloat255(Plain):
    def render(self):
        return super().render().astype(np.float64)


@odd(noticed=r"its picture is of int64")
class PictureInt64(Plain):
    def render(self):
        return super().render().astype(np.int64)


@odd(r"render\(\) returned int64 values from 0 to 1, which are shown as black")
class PictureMask(Plain):
    def render(self):
        return (super().render() > 100).astype(np.int64)


@odd(r"render\(\) returned a picture of type bool")
class PictureBool(Plain):
    def render(self):
        return super().render() > 100


@odd(r"render\(\) returned a picture of type object")
class PictureObject(Plain):
    def render(self):
        return super().render().astype(object)


@odd(r"render\(\) returned values from -1 to 1")
class PictureSigned(Plain):
    def render(self):
        return super().render() / 127.5 * (240 / 240) - 1 if self.count < 0 else np.float32([[[-1, 0, 1]]])


@odd(r"render\(\) returned values from .* to 65535")
class PictureUint16(Plain):
    def render(self):
        picture = super().render().astype(np.uint16)
        picture[0, 0] = 65535
        return picture


@odd(r"render\(\) returned a picture with NaN")
class PictureNaN(Plain):
    def render(self):
        picture = super().render().astype(np.float64)
        picture[0, 0, 0] = np.nan
        return picture


@odd(r"a grey picture needs its channel three times")
class PictureGrey(Plain):
    def render(self):
        return super().render()[..., 0]


@odd(r"a grey picture needs its channel three times")
class PictureOneChannel(Plain):
    def render(self):
        return super().render()[..., :1]


@odd(r"leave out the transparency")
class PictureTransparent(Plain):
    def render(self):
        return np.dstack([super().render(), np.full((40, 48), 255, np.uint8)])


@odd(r"the colours come last")
class PictureChannelFirst(Plain):
    def render(self):
        return super().render().transpose(2, 0, 1)


@odd(r"render\(\) returned nothing \(None\)")
class PictureNone(Plain):
    def render(self):
        return None


@odd(r"render\(\) returned nothing \(None\).*step 5 of")
class PictureNoneLater(Plain):
    def render(self):
        return None if self.count == 5 else super().render()


@odd(r"render\(\) returned the text")
class PictureText(Plain):
    def render(self):
        return "a picture"


@odd(r"render\(\) returned a list of")
class PictureList(Plain):
    def render(self):
        return [super().render()]


@odd(r"render\(\) returned an array of shape \(0, 0, 3\)")
class PictureEmpty(Plain):
    def render(self):
        return np.zeros((0, 0, 3), np.uint8)


@odd(r"render\(\) raised RuntimeError: no display")
class PictureRaises(Plain):
    def render(self):
        raise RuntimeError("no display")


@odd(r"render\(\) tried to end the program")
class PictureExits(Plain):
    def render(self):
        raise SystemExit


@odd(noticed=r"its picture changes size", unexportable=r"picture changes size")
class PictureGrows(Plain):
    def render(self):
        picture = super().render()
        return picture.repeat(2, axis=0).repeat(2, axis=1) if self.count >= 5 else picture


@odd()
class PictureOnePixel(Plain):
    def render(self):
        return super().render()[8:9, 8:9]


@odd()
class PictureOddSize(Plain):
    def render(self):
        return super().render()[:37, :47]


@odd()
class PictureWide(Plain):
    def render(self):
        return np.tile(super().render()[:2], (1, 40, 1))


@odd()
class PictureReadOnly(Plain):
    def render(self):
        picture = super().render()
        picture.flags.writeable = False
        return picture


@odd()
class PictureFlipped(Plain):
    def render(self):
        return super().render()[::-1, ::-1, ::-1]


@odd()
class PictureOneBuffer(Plain):
    def render(self):
        self.buffer = getattr(self, "buffer", np.zeros((40, 48, 3), np.uint8))
        self.buffer[:] = super().render()
        return self.buffer


@odd()
class PictureAllBlack(Plain):
    def render(self):
        return np.zeros((40, 48, 3), np.float32)


@odd(r"drawing changes it: with pictures")
class PictureDrawsNumbers(Plain):
    def render(self):
        self.np_random.random()
        return super().render()


@odd(r"drawing changes it: with pictures")
class PictureMoves(Plain):
    def render(self):
        self.place = (self.place + 1) % 5
        return super().render()


@odd(r"the picture at .* differs between two plays")
class PictureNoise(Plain):
    def render(self):
        picture = super().render()
        picture[:4] = np.random.default_rng().integers(255, size=(4, 48, 3))
        return picture
