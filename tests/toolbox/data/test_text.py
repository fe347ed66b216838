"""Points in text files: names, separators, and what is wrong on which line."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from toolbox.data import PointCloud
from toolbox.errors import DataError


def opened(tmp_path: Path, text: str, suffix: str = ".txt", **options: Any) -> PointCloud:
    path = tmp_path / f"points{suffix}"
    path.write_bytes(gzip.compress(text.encode()) if suffix.endswith(".gz") else text.encode())
    return PointCloud.open(path, **options)


@pytest.mark.parametrize("separator", [" ", "\t", ",", ";", "   ", ", "])
@pytest.mark.parametrize("header", ["", "X{s}Y{s}Elevation{s}Class\n", "# made by hand\n\n"])
@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".txt.gz"])
def test_separators_headers_and_comments(
    tmp_path: Path, separator: str, header: str, suffix: str
) -> None:
    lines = [separator.join(row) for row in (["1.5", "2", "-3e2", "6"], ["4", "5", "6.25", "2"])]
    text = header.replace("{s}", separator) + "\n".join([lines[0], "# in between", lines[1], ""])
    cloud = opened(tmp_path, text, suffix)
    assert cloud.xyz.tolist() == [[1.5, 2, -300], [4, 5, 6.25]]
    name = "classification" if "Class" in header else "column4"
    assert cloud.names == (name,)
    assert cloud[name].tolist() == [6, 2]
    assert cloud[name].dtype == (np.uint8 if "Class" in header else np.int32)


@pytest.mark.parametrize(
    "line", ["//X Y Z Intensity", "# x y z intensity", "// Easting Northing Z I"]
)
def test_names_in_a_comment(tmp_path: Path, line: str) -> None:
    cloud = opened(tmp_path, f"{line}\n1 2 3 4\n")
    assert cloud["intensity"].tolist() == [4]
    assert cloud["intensity"].dtype == np.uint16


def test_names_are_those_of_las(tmp_path: Path) -> None:
    header = (
        "Northing,Easting,z,GpsTime,ReturnNumber,Number Of Returns,Scan_Angle_Rank,R,G,B,height"
    )
    cloud = opened(tmp_path, header + "\n1,2,3,4.5,1,2,-7,100,200,300,9\n")
    assert cloud.xyz.tolist() == [[2, 1, 3]]
    assert cloud.names == (
        "gps_time",
        "return_number",
        "number_of_returns",
        "scan_angle_rank",
        "red",
        "green",
        "blue",
        "height",  # not z, which is there already
    )
    assert cloud["scan_angle_rank"].dtype == np.int8


def test_columns_may_be_named(tmp_path: Path) -> None:
    cloud = opened(tmp_path, "1 2 3 4\n", columns=["y", "x", "z", "label"])
    assert cloud.xyz.tolist() == [[2, 1, 3]]
    assert cloud["label"].tolist() == [4]
    header = opened(tmp_path, "a b c d\n1 2 3 4\n", columns=["x", "y", "z", "label"])
    assert header["label"].tolist() == [4]
    assert opened(tmp_path, "1|2|3\n", separator="|").xyz.tolist() == [[1, 2, 3]]


def test_pts_files(tmp_path: Path) -> None:
    cloud = opened(tmp_path, "2\n1 2 3 -5 10 20 30\n4 5 6 7 10 20 30\n", ".pts")
    assert cloud["intensity"].tolist() == [-5, 7]
    assert cloud["blue"].tolist() == [30, 30]
    with pytest.raises(DataError, match="promises 3 points, and 2 are there"):
        opened(tmp_path, "3\n1 2 3\n4 5 6\n", ".pts")
    assert len(opened(tmp_path, "0\n", ".pts")) == 0


def test_whole_numbers_become_integers(tmp_path: Path) -> None:
    cloud = opened(tmp_path, "x y z a b c gps_time\n1 2 3 1.0 1.5 9007199254740993 5\n")
    assert cloud["a"].dtype == np.int32
    assert cloud["b"].dtype == np.float64
    assert cloud["c"].tolist() == [2**53 + 1]
    assert cloud["gps_time"].dtype == np.float64
    assert np.isnan(opened(tmp_path, "1 2 3 nan\n")["column4"]).all()


@pytest.mark.parametrize(
    "text",
    [
        "500000,25;-2,5;3,125\n7;8;9,5\n",
        "500000,25\t-2,5\t3,125\n7\t8\t9,5\n",
        "500000,25 -2,5 3,125\n7 8 9,5\n",
        "Rechtswert;Hochwert;Höhe\n500000,25;-2,5;3,125\n7;8;9,5\n",
        "Nr;Rechtswert;Hochwert;Höhe\nP1;500000,25;-2,5;3,125\nP2;7;8;9,5\n",
    ],
)
def test_commas_before_decimals_are_read_and_told(
    tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert opened(tmp_path, text).xyz.tolist() == [[500000.25, -2.5, 3.125], [7, 8, 9.5]]
    assert "commas are read as decimal points" in caplog.text


def test_whole_numbers_tell_no_decimals(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Spreadsheets write 3 for 3,0: the first number that is not whole tells the mark."""
    lines = "1;2;3;4\n" * 3
    assert opened(tmp_path, f"{lines}1;2;3,5;4,25\n").xyz[-1].tolist() == [1, 2, 3.5]
    caplog.clear()
    assert opened(tmp_path, f"{lines}1;2;3.5;4.25\n").xyz[-1].tolist() == [1, 2, 3.5]
    assert opened(tmp_path, "1,2,3,4\n5,6,7,8\n").xyz[-1].tolist() == [5, 6, 7]
    assert not caplog.text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n4 5\n", "line 2: 2 values instead of 3"),
        ("1 2 3\n\n4 5 6 7\n", "line 3: 4 values instead of 3"),
        ("1 2 3\n4 x 6\n", "line 2: y is 'x', which is not a number"),
        ("x,y,z,i\n1,2,3,4\n1,2,3,\n", "line 3: intensity is '', which is not a number"),
        ("1;2.5;3\n1;2,5;3\n", "line 2: y is '2,5'.*decimals must have a point, as further above"),
        ("1;2,5;3\n1;2.5;3\n", "line 2: y is '2.5'.*decimals must have a comma, as further above"),
        ("1,5;2.5;3,5\n", "line 1.*decimals must all have a point, or all a comma"),
        ("1;2,5;nan\n", "line 1: z is nan"),
        ("x,y,z\n1,5,2,5,3,5\n", "where decimals have commas, semicolons must separate columns"),
        ("1 2 3\n1 2 nan\n", "line 2: z is nan"),
        ("1 2 3\n1 inf 3\n", "line 2: y is inf"),
        ("x y z\n1 2 3 4\n", "line 2: 4 values for the 3 columns"),
        ("x y z\n1 2 word\n", "line 2.*not a line of numbers"),
        ("x y height width\n1 2 3 4\n", None),
        ("a b c\n1 2 3\n", "has no column x, y, z"),
        ("x y z z\n1 2 3 4\n", "several columns z"),
        ("# nothing\n", "holds no points"),
        ("1 2\n", "not a line of numbers"),
        ("P0 1 2 3\nP1 4 5 6\n", "first line with the names of all, such as id x y z"),
        ("ncols 4\nnrows 3\n", "is a raster"),
        ("\0\1\2 \xff\n", "has no column x, y, z"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    if message is None:  # "height" is z where there is no other
        assert opened(tmp_path, text)["z"].tolist() == [3]
        return
    with pytest.raises(DataError, match=message):
        opened(tmp_path, text)


def test_other_damage(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="one character"):
        opened(tmp_path, "1 2 3\n", separator="ab")
    with pytest.raises(DataError, match="4 columns"):
        opened(tmp_path, "1 2 3\n", columns=["x", "y", "z", "w"])
    packed = gzip.compress(b"1 2 3\n" * 1000)
    for content in (b"not gzip", packed[:-20]):
        (tmp_path / "a.txt.gz").write_bytes(content)
        with pytest.raises(DataError, match=r"a\.txt\.gz"):
            PointCloud.open(tmp_path / "a.txt.gz")
    (tmp_path / "a.txt").write_bytes(b"1 2 3\n1 2 \xff\n")
    with pytest.raises(DataError, match=r"a\.txt"):
        PointCloud.open(tmp_path / "a.txt")


def test_a_line_of_names_alone_is_an_empty_cloud(tmp_path: Path) -> None:
    cloud = opened(tmp_path, "x,y,z,intensity\n")
    assert len(cloud) == 0
    assert cloud.names == ("intensity",)


@pytest.mark.parametrize("suffix", [".csv", ".xyz", ".txt", ".csv.gz"])
def test_writing_and_reading_again(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(3)
    attributes = {
        "intensity": rng.integers(0, 65536, 50).astype(np.uint16),
        "gps_time": rng.random(50) * 3e8,
        "ratio": rng.random(50).astype(np.float32),
        "flag": rng.random(50) > 0.5,
        "big": rng.integers(-(2**62), 2**62, 50),
        "unknown": np.where(rng.random(50) > 0.5, np.nan, 0.25),
    }
    cloud = PointCloud(rng.random((50, 3)) * [1e6, 1e-6, 1], attributes)
    cloud.save(tmp_path / f"a{suffix}")
    if suffix.endswith(".gz"):  # no time of writing, so that files can be compared
        assert (tmp_path / f"a{suffix}").read_bytes()[4:8] == bytes(4)
    again = PointCloud.open(tmp_path / f"a{suffix}")
    assert np.array_equal(again.xyz, cloud.xyz)
    assert again.names == cloud.names
    for name in cloud.names:
        found = again[name].astype(cloud[name].dtype)
        assert np.array_equal(found, cloud[name], equal_nan=True), name


def test_coordinates_have_the_decimals_of_their_scale(tmp_path: Path) -> None:
    PointCloud([[500000.125, 1, 2.5], [1, 2, 3]]).save(tmp_path / "a.las")
    cloud = PointCloud.open(tmp_path / "a.las")
    cloud.select([0]).save(tmp_path / "a.xyz")
    assert (tmp_path / "a.xyz").read_text().splitlines()[1].startswith("500000.125 1.00 2.50 ")
    PointCloud.open(tmp_path / "a.xyz").save(tmp_path / "b.las")
    assert np.array_equal(PointCloud.open(tmp_path / "b.las").xyz, cloud.xyz[:1])


def test_names_that_no_column_can_have(tmp_path: Path) -> None:
    cloud = PointCloud([[0, 0, 0]], {"echo width": [1], "7": [1]})
    with pytest.raises(DataError, match="'echo width' has a blank"):
        cloud.save(tmp_path / "a.xyz")
    with pytest.raises(DataError, match="'=x' cannot be the name"):
        PointCloud([[0, 0, 0]], {"=x": [1]}).save(tmp_path / "a.csv")
    with pytest.raises(DataError, match="'7' cannot be the name"):
        cloud.save(tmp_path / "a.csv")


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(content=st.binary(max_size=80) | st.text(alphabet="1234.,;- \n\t#/xyze", max_size=80))
def test_any_text_gives_an_error_or_a_cloud(tmp_path: Path, content: bytes | str) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    try:
        cloud = PointCloud.open(path)
    except DataError as error:
        found = str(error)
    else:
        found = "a.txt" if np.isfinite(cloud.xyz).all() else "coordinates"
    assert "a.txt" in found


@pytest.mark.parametrize(
    "header",
    [
        "Point;East;North;Height;Code",
        "No;Rechtswert;Hochwert;Höhe;Art",
        "Nokta No;Sağa (Y);Yukar\u0131 (X);Kot;Kod",
        "NOKTA;SAĞA DEĞER;YUKARI DEĞER;YÜKSEKLİK;KOD",
        "id;E;N;H;code",
        "id;X [m];Y [m];H [m];code",
        "id;Y (Easting);X (Northing);Z;code",
    ],
)
def test_header_names_of_surveyors(
    tmp_path: Path, header: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Names and codes of points are texts, which are left out with a word."""
    text = f"{header}\nP1;500010.5;4500020.5;12.25;GR\nP2;500011.5;4500021.5;12.5;\n"
    cloud = opened(tmp_path, text, ".csv")
    assert cloud.xyz.tolist() == [[500010.5, 4500020.5, 12.25], [500011.5, 4500021.5, 12.5]]
    assert cloud.names == ()
    first, *_, last = header.split(";")
    assert f"texts are left out of points: {first}, {last}" in caplog.text


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("No,Y,X,Z", "columns Y, X stand in this order, in which Y may be the easting"),
        ("Nokta,y,x,Kot", "columns y, x stand in this order"),
        ("X,Y,H,h", "columns H and h may both be z"),
        ("East,Rechtswert,North,Z", "columns East and Rechtswert may both be x"),
    ],
)
def test_names_that_may_be_either_are_refused(tmp_path: Path, header: str, message: str) -> None:
    line = "1,500010.5,4500020.5,12.25"
    with pytest.raises(DataError, match=message):
        opened(tmp_path, f"{header}\n{line}\n", ".csv")
    told = opened(tmp_path, f"{header}\n{line}\n", ".csv", columns=["name", "x", "y", "z"])
    assert told.xyz.tolist() == [[500010.5, 4500020.5, 12.25]]


def test_a_line_with_too_much_beside_texts(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="line 3: 5 values instead of 4"):
        opened(tmp_path, "No,E,N,H\nP1,1,2,3\nP2,1,2,3,4\n", ".csv")
    with pytest.raises(DataError, match="line 3: z is 'a', which is not a number"):
        opened(tmp_path, "No,E,N,H\nP1,1,2,3\nP2,1,2,a\n", ".csv")


def test_single_precision_is_told_where_few_digits_are_written(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As by programs that write no more digits than tell a number from the next one."""
    xyz = np.random.default_rng(0).uniform(0, 20, (99, 3))
    xyz += np.array([500_000, 4_500_000, 100])
    single = xyz.astype(np.float32)
    for name, values in (("a.csv", single.astype(float)), ("b.csv", xyz)):
        np.savetxt(tmp_path / name, values, "%.2f", ",", header="x,y,z", comments="")
        PointCloud.open(tmp_path / name)
    (told,) = caplog.messages
    assert told.startswith("a.csv: its coordinates were rounded to single precision, x to 0.03125")


@pytest.mark.parametrize(
    ("corner", "digits", "single", "told"),
    [
        ((500_000, 4_500_000, 100), 3, True, "x to 0.03125, y to 0.5"),
        ((500_000, 4_500_000, 100), 3, False, ""),
        ((500_000, 4_500_000, 100), 0, True, ""),  # a raster with cells of whole metres
        ((0, 0, 100), 3, True, ""),  # steps of a micrometre
    ],
)
def test_coordinates_of_single_precision_are_told(
    corner: Any,
    digits: int,
    single: bool,
    told: str,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    xyz = (np.random.default_rng(0).uniform(0, 20, (99, 3)) + corner).round(digits)
    path = tmp_path / "scan.csv"
    np.savetxt(
        path, xyz.astype(np.float32) if single else xyz, "%.8f", ",", header="x,y,z", comments=""
    )
    PointCloud.open(path)
    assert [*caplog.messages] == (
        [f"scan.csv: its coordinates were rounded to single precision, {told}"] if told else []
    )
