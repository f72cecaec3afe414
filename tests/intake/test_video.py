"""A video is cut into its sharpest pictures."""

from pathlib import Path

import av
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from silmesh.cli.main import main
from silmesh.errors import InputError
from silmesh.intake.video import PARTS, cut

WIDTH, HEIGHT = 64, 48


def film(path: Path, pictures: list[np.ndarray]) -> Path:
    """A video of pictures [height, width, 3] uint8."""
    with av.open(str(path), "w", format="mp4") as video:
        stream = video.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.options = {"crf": "10"}
        for picture in pictures:
            video.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        video.mux(stream.encode())
    return path


def grey(level: int, stripes: bool) -> np.ndarray:
    """A picture of one grey level, or with stripes of eight pixels about it."""
    picture = np.full((HEIGHT, WIDTH, 3), level, np.uint8)
    if stripes:
        picture[:, np.arange(WIDTH) % 16 < 8] += 30
    return picture


def test_the_sharpest_picture_of_each_part_is_taken(tmp_path):
    # Three pictures a part, of which the second has edges; the level tells the parts apart.
    levels = np.linspace(40, 190, PARTS).astype(int)
    pictures = [grey(level, i == 1) for level in levels for i in range(3)]
    video = film(tmp_path / "turn.mp4", pictures)
    files = cut(video, tmp_path / "frames")
    assert len(files) == PARTS
    for file, level in zip(files, levels, strict=True):
        with Image.open(file) as image:
            taken = np.asarray(image.convert("L")).astype(int)
        assert taken.shape == (HEIGHT, WIDTH)
        assert taken.max() - taken.min() > 20
        assert np.median(taken[:, 12]) == pytest.approx(level, abs=6)


def test_it_is_cut_once_and_again_when_it_changed(tmp_path):
    video = film(tmp_path / "turn.mp4", [grey(90, False)] * 4)
    files = cut(video, tmp_path / "frames")
    assert len(files) == 4
    made = files[0].stat().st_mtime_ns
    assert cut(video, tmp_path / "frames")[0].stat().st_mtime_ns == made
    film(video, [grey(90, True)] * 5)
    assert len(cut(video, tmp_path / "frames")) == 5


def test_what_is_no_video_is_refused(tmp_path):
    (tmp_path / "turn.mp4").write_bytes(b"no video")
    with pytest.raises(InputError, match=r"turn.mp4: cannot be read as a video"):
        cut(tmp_path / "turn.mp4", tmp_path / "frames")
    assert not (tmp_path / "frames").exists()


def test_a_video_is_cut_where_the_run_will_work(tmp_path):
    """The options are wrong, so it ends after that; a folder of a person's is refused before."""
    video = film(tmp_path / "a.mp4", [grey(100, True)] * 6)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "frames").write_text("a person's")
    words = [str(video), "--size", "3", "--silhouettes", "threshold", "--cameras", "calibrate"]
    for name, expected in (
        ("work", "views.size"),
        ("work", "views.size"),
        ("mine", "holds frames"),
    ):
        done = CliRunner().invoke(main, [*words, "--keep", str(tmp_path / name)])
        assert done.exit_code == 2
        assert expected in done.output
    assert {path.name for path in (tmp_path / "work").iterdir()} == {"silmesh.json", "video"}
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["frames"]
