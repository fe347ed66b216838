"""Texts in other languages: which is chosen, what is translated, and that catalogues are whole."""

from __future__ import annotations

import json
from pathlib import Path

import polib
import pytest

from toolbox import catalog, language, translations
from toolbox.cli.main import main
from toolbox.data import Report, Rows, Section, Table
from toolbox.labels import LONGEST_TITLE
from toolbox.reports.page import Told
from toolbox.reports.readme import Entry, readme

LANGUAGES = sorted(path.name for path in language.FOLDER.iterdir())
CATALOGUES = [(code, name) for code in LANGUAGES for name in ("tools.po", "messages.po", "told.po")]


def read(code: str, name: str) -> polib.POFile:
    return polib.pofile(str(language.FOLDER / code / name), encoding="utf-8")


@pytest.mark.parametrize(
    ("variables", "code"),
    [
        ({}, "en"),
        ({"TOOLBOX_LANG": "tr"}, "tr"),
        ({"TOOLBOX_LANG": "en", "LANG": "tr_TR.UTF-8"}, "en"),
        ({"LANG": "tr_TR.UTF-8"}, "tr"),
        ({"LC_ALL": "C", "LANG": "tr_TR.UTF-8"}, "en"),
        ({"TOOLBOX_LANG": "xx"}, "en"),
        ({"TOOLBOX_LANG": "../translations/tr"}, "en"),
    ],
)
def test_the_language_is_that_of_the_user(
    variables: dict[str, str], code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in language.VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert language.chosen() == code


def test_help_and_list_are_translated_and_json_is_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TOOLBOX_LANG", "tr")
    assert main(["describe", "surface.grid"]) == 0
    said = capsys.readouterr().out
    assert "Noktaları raster olarak gridle" in said
    assert said.startswith("kullanım: python -m toolbox run surface.grid --points ...")
    assert "--cell NUMBER" in said
    assert "girdiler:" in said
    assert "show this help" not in said
    assert main(["list"]) == 0
    assert "surface.grid" in (listed := capsys.readouterr().out)
    assert "Noktalardan, hücre" in listed
    assert main(["list", "zemini", "sınıflandır"]) == 0
    assert "ground.classify" in capsys.readouterr().out
    assert main([]) == 0
    assert "tüm araçlar" in capsys.readouterr().out
    assert main(["list", "contour"]) == 0  # English words find as well
    assert "surface.contours" in capsys.readouterr().out
    assert main(["describe", "surface.grid", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == catalog.describe("surface.grid")


@pytest.mark.parametrize(("code", "name"), CATALOGUES)
def test_translations_hold_the_names_of_their_texts(code: str, name: str) -> None:
    wrong = {e.msgid: translations.wrong(e) for e in read(code, name).translated_entries()}
    assert not {text: names for text, names in wrong.items() if names}


def test_names_that_a_translation_must_hold() -> None:
    entry = polib.POEntry(msgid="Take `cell` of {name}, see --tile", msgstr="`cel` {name} --tile")
    assert translations.wrong(entry) == {"`cell`", "`cel`"}


def test_what_must_stay_may_be_wrapped_elsewhere() -> None:
    entry = polib.POEntry(msgid="``a > 1``. Of `3=x\n4=y`", msgstr="`3=x 4=y` of\n``a > 1``.")
    assert not translations.wrong(entry)


@pytest.mark.parametrize(
    ("english", "turkish"),
    [
        ("points: there are none", "points: hiç nokta yok"),  # a parameter keeps its name
        ("191 points withheld.", "withheld: 191 nokta."),
        ("Wires, Towers", "Teller, Direkler"),
        ("must be a, got 'c'; did you mean 'b'?", "a olmalı, verilen 'c'; 'b' mı demek istediniz?"),
        (  # a value that has another one beside it ends where that begins
            "no tool called 'ground.clasify'; did you mean 'ground.classify'?",
            "'ground.clasify' adında bir araç yok; 'ground.classify' mı demek istediniz?",
        ),
        (  # the longest text counts, also if the last full stop is its own
            "3 points were taken for noise: 2 low, 1 high.",
            "3 nokta gürültü sayıldı: 2 alçak, 1 yüksek.",
        ),
        (
            "Of the area by cells, as seen from above (crowns and bridges hide what is below them; "
            "outlines have other areas; cells without points are water within its outlines, have "
            "the class beside them in narrow gaps, and do not count else): ground 80.3 %, bridge "
            "deck 0.5 %.",
            "Hücrelere göre, yukarıdan görüldüğü gibi alan (taçlar ve köprüler altlarındakini "
            "gizler; sınırların alanları başkadır; noktasız hücreler suyun sınırları içinde sudur, "
            "dar boşluklarda yanlarındaki sınıfı alır, yoksa sayılmaz): zemin 80.3 %, köprü "
            "tabliyesi 0.5 %.",
        ),
        (
            "One water body of 455 m² in all, 13 m² more or less, without what lies below "
            "bridges, jetties and boats; its level is 116.799 m, ± 0.001 m within the survey (95 "
            "% intervals); an error that all of its heights have in common "
            "comes on top.",
            "Bir su kütlesi, toplam 455 m², 13 m² fazla veya eksik, köprülerin, iskelelerin "
            "ve teknelerin altında kalan hariç; seviyesi 116.799 m, "
            "ölçüm içinde ± 0.001 m (% 95 aralıkları); ölçümün tüm yüksekliklerinde ortak olan "
            "bir hata buna eklenir.",
        ),
        (  # data in feet
            "3 water bodies of 2874 m² (30935 ft²) in all, 138 m² (1485 ft²) more or less, without "
            "what lies below bridges, jetties and boats; the level of the largest is 411.087 ft.",
            "3 su kütlesi, toplam 2874 m² (30935 ft²), 138 m² (1485 ft²) fazla veya eksik, "
            "köprülerin, iskelelerin ve teknelerin altında kalan hariç; en büyüğünün seviyesi "
            "411.087 ft.",
        ),
        (
            "2 water bodies of 900 m² in all, 10 m² more or less, without what lies below "
            "bridges, jetties and boats; the level of the largest is 411.087 ft. The surface of "
            "the largest falls from 412.000 to 410.000 ft; the level "
            "is that of its middle.",
            "2 su kütlesi, toplam 900 m², 10 m² fazla veya eksik, köprülerin, iskelelerin "
            "ve teknelerin altında kalan hariç; en büyüğünün seviyesi 411.087 ft. En büyüğünün "
            "yüzeyi 412.000 kotundan 410.000 ft kotuna alçalır; seviye, ortasının "
            "seviyesidir.",
        ),
        (
            "The survey has 2.2 pulses per square metre (0.20/ft²), 0.68 m (2.23 ft) apart; "
            "0.10 % of it are voids, be they water or not. 2 strips overlap on 30 % of it.",
            "Ölçmede metrekareye 2.2 (0.20/ft²) atım var, 0.68 m (2.23 ft) aralıklı; % 0.10 "
            "kadarı, su olsun olmasın, boşluk. 2 şerit, ölçmenin % 30 kadarında örtüşüyor.",
        ),
        ("5 % are lower", "% 5 daha düşük"),
        ("40 critical, 124 warning, 0 watch", "40 kritik, 124 uyarı, 0 izle"),
        ("tree 94, unclassified 3", "ağaç 94, sınıflandırılmamış 3"),
        ("tree 2.5 m, building 4 m", "ağaç 2.5 m, bina 4 m"),
        ("Class 26", "Sınıf 26"),
        (
            "NERC FAC-003-4, table 2, 345 kV, sea level",
            "NERC FAC-003-4, tablo 2, 345 kV, deniz düzeyi",
        ),
        ("Plot 2", "Plot 2"),  # as people have called it
        (
            "well spread: at least 20% of them belong in each quarter; fewest in the north-west",
            "iyi yayılmış: her çeyrekte en az 20% kadarı olmalı; en azı kuzeybatı yönünde",
        ),
        (  # each raster by itself
            "Rasters have cells of 1 m. Terrain from 0.76 to 15.00 m, 0.7 % of its cells empty.",
            "Rasterlerin hücreleri 1 m. Arazi 0.76 - 15.00 m, hücrelerinin % 0.7 kadarı boş.",
        ),
        (  # a sentence within a sentence keeps its full stop
            "The survey has 2.0 pulses per square metre, 0.71 m apart; 0.10 % of it are voids, "
            "be they water or not. 2 strips overlap on 30 % of it.",
            "Ölçmede metrekareye 2.0 atım var, 0.71 m aralıklı; % 0.10 kadarı, su olsun "
            "olmasın, boşluk. 2 şerit, ölçmenin % 30 kadarında örtüşüyor.",
        ),
        ("cell: must be > 0 and <= 9 m, got 0.0", "cell: > 0 ve <= 9 m olmalı, verilen 0.0"),
        (
            "no rule: the table of a.csv used here has none for ground; listed within 6 m",
            "kural yok: burada kullanılan a.csv tablosunda zemin için kural yok; 6 m içinde "
            "listelenir",
        ),
    ],
)
def test_texts_are_found_in_others(english: str, turkish: str) -> None:
    with language.speaking("tr"):
        assert language.told(english) == turkish


def test_the_readme_of_a_set_is_translated() -> None:
    columns = [("ground", "m", "To the ground")]
    entry = Entry("spans.csv", "", "The report to print", 8000, "", columns, without=3000)
    spec = catalog.load("models.terrain")
    with language.speaking("tr"):
        told = Told(warnings=["land of 2.5 m2 is lost"])
        text = readme(spec, {}, None, told, [entry], {"client": "Muş 2.5"}, {})
    said = (
        "Yazdırmak için rapor [8\u202f000]; okunan noktalardan 3\u202f000 tanesi içinde yoktur",
        "ground  Uzaklık: zemin [m]",
        "- Land of 2,5 m² is lost",
        "  Muş 2.5\n",
    )
    assert [part for part in said if part not in text] == [], text


@pytest.mark.parametrize("code", LANGUAGES)
def test_all_texts_are_translated_and_none_is_stale(code: str) -> None:
    """`make translations` brings new texts in, and takes out those that are gone."""
    for name, texts in translations.sources().items():
        said = {entry.msgid for entry in read(code, name).translated_entries()}
        assert not (missing := set(texts) - said), f"{code}/{name} lacks {sorted(missing)}"
        assert not (stale := said - set(texts)), f"{code}/{name}: not in the code: {sorted(stale)}"


@pytest.mark.parametrize("code", LANGUAGES)
def test_titles_of_tools_have_room_in_dialogs(code: str) -> None:
    said = language.catalogue(code)
    titles = [catalog.describe(id)["title"] for id in catalog.own_ids()]
    longest = LONGEST_TITLE + 10  # most languages need more letters
    assert not [title for title in titles if len(said.get(title, "")) > longest]


def test_intensity_and_density_have_words_of_their_own_in_turkish() -> None:
    """Both had been yoğunluk, which is density; intensity is yansıma şiddeti."""
    of_intensity = [
        entry.msgstr
        for name in translations.sources()
        for entry in read("tr", name).translated_entries()
        if "intensit" in entry.msgid.lower() and "dens" not in entry.msgid
    ]
    assert sum("yansıma şiddet" in text.lower() for text in of_intensity) > 20
    assert not [text for text in of_intensity if "yoğunlu" in text.lower()]


def test_an_update_keeps_what_is_translated_and_retires_what_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "tools.po"
    old = translations.update(path, ["Points", "Gone"], "tr")
    for entry in old:
        entry.msgstr = {"Points": "Noktalar", "Gone": "Giden"}[entry.msgid]
    old.save(str(path))
    made = translations.update(path, ["Points", "New"], "tr")
    assert [(e.msgid, e.msgstr, bool(e.obsolete)) for e in made] == [
        ("Points", "Noktalar", False),
        ("New", "", False),
        ("Gone", "Giden", True),
    ]
    made.save(str(path))
    again = translations.update(path, ["Gone"], "tr")
    assert again.find("Gone").msgstr == "Giden"


def test_texts_with_values_are_found_and_numbers_have_commas(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("TOOLBOX_LANG", "tr")
    text = "3 points have no counterpart in the other cloud"
    assert language.told(text) == "3 noktanın diğer bulutta karşılığı yok"
    two = "surface.grid: 1 problem\n  cell: must be > 0 m, got -1"
    assert language.told(two) == "surface.grid: 1 sorun\n  cell: > 0 m olmalı, verilen -1"
    file = "points: a.laz holds no points"
    assert language.told(file) == "points: a.laz nokta içermiyor"
    short = "points: a.laz is cut off: its header promises 10 points, and 8 are there"
    assert language.told(short) == (
        "points: a.laz kesilmiş: başlığı 10 nokta vaat ediyor, 8 tanesi var"
    )
    assert language.told("7 of us. No building is here") == "7 of us. No building is here"
    longer = "No buildings were found. 40 % of the points lie on no plane."
    assert language.told(longer) == (
        "Bina bulunamadı. Noktaların % 40 kadarı hiçbir düzlemde değil."
    )
    assert language.decimals("0.5 m, v1.2.3, a_1.tif, 2026-11-24, 29 CFR § 1926.1408") == (
        "0,5 m, v1.2.3, a_1.tif, 2026-11-24, 29 CFR § 1926.1408"
    )
    monkeypatch.setenv("TOOLBOX_LANG", "en")
    assert language.told(text) == text
    assert language.decimals("0.5") == "0.5"


def test_what_machines_read_is_no_text() -> None:
    texts = set(translations.of_told())
    machines = {"Software", "VERSION", "Polygon", "PYTHONPATH", "easting,east", "LENGTH"}
    assert not machines & texts
    codes = ("INSERT", "proj=", "stroke-", "import toolbox", ";;", "C:\\", "metadata.txt")
    assert not [text for text in texts if any(code in text for code in codes)]
    assert {"Client", "{1} cannot be read", "the server cannot be reached"} <= texts


def test_texts_are_written_in_one_piece() -> None:
    """A sentence that is put together of halves would be found by neither."""
    bare = [text for text in translations.pieces() if text.rstrip()[-1:] not in ";:."]
    assert not [text for text in bare if text.endswith(" ") and " " in text.strip()]
    assert not [text for text in translations.pieces() if "\n" in text.strip()], "told by lines"


def test_a_report_speaks_the_language_of_its_user(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = Rows(Table.from_rows([{"kind": "tree", "seen": True, "points": 0.25}]))
    report = Report("Quality of a survey", [Section("Spans", [rows])], summary="None.")
    report = report.titled(client="Muş 2.5", date="2026-11-24")
    monkeypatch.setenv("TOOLBOX_LANG", "tr")
    page = report.html()
    for text in (
        'lang="tr"',
        ">Açıklıklar<",
        ">Müşteri<",
        ">evet<",
        ">0,2500<",
        ">Özet<",
        ">Muş 2.5<",
        "Yakınlaş",
    ):
        assert text in page
    monkeypatch.setenv("TOOLBOX_LANG", "en")
    page = report.html()
    for text in ('lang="en"', ">Spans<", ">Client<", ">yes<", ">0.2500<"):
        assert text in page
    assert "Yakınlaş" not in page


def test_help_in_turkish_has_its_own_small_letters() -> None:
    with language.speaking("tr"):
        assert language.uncapitalised("Işığın geldiği yön") == "ışığın geldiği yön"
        assert language.uncapitalised("Intensity") == "intensity"
        assert language.uncapitalised("IoU") == "IoU"
        assert [language.capitalised(word) for word in ("iki", "intensity")] == ["İki", "Intensity"]


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("de", True),
        ("de_AT.UTF-8", True),
        ("../tr", True),
        ("tr", False),
        ("en_GB", False),
        ("", False),
        ("C", False),
    ],
)
def test_a_language_that_there_is_not_is_told_once(
    said: str, told: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TOOLBOX_LANG", said)
    assert main([]) == 0
    text = f"TOOLBOX_LANG={said}: texts are English; there are only en, tr\n"
    assert capsys.readouterr().err == (text if told else "")
