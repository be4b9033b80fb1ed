"""Subjects on the pages: who there is, what is known of them, and which recordings are theirs."""

import re
from collections.abc import Callable

import httpx

from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]


def give(fake: FakeService, recording_id: str, subject_id: str) -> None:
    fake.recordings[recording_id] = fake.recordings[recording_id].model_copy(update={"subject_id": subject_id})


def test_the_table_counts_the_recordings_of_everybody(fake: FakeService, browse: Browse) -> None:
    tall, nameless = fake.subjects.add("P07", height_m=1.92, sex="male", age_years=31), fake.subjects.add(None)
    for _ in range(2):
        give(fake, fake.add_recording().id, tall.subject_id)
    page = browse("/subjects").text
    rows = dict(re.findall(r'<tr data-subject="(\w+)">(.*?)</tr>', page, re.DOTALL))
    cells = [re.sub(r"<[^>]+>", "", cell) for cell in re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", rows[tall.subject_id])]
    assert cells[:6] == ["P07", "male", "1.92 m", "–", "31 years", "2"]
    assert f">{nameless.subject_id}</a>" in rows[nameless.subject_id]


def test_the_page_of_one_lists_the_recordings_and_offers_those_of_nobody(fake: FakeService, browse: Browse) -> None:
    person, other = fake.subjects.add(), fake.subjects.add("P08")
    own, free, taken = fake.add_recording("own.c3d"), fake.add_recording("free.c3d"), fake.add_recording("taken.c3d")
    sample = fake.add_recording("sample.c3d", bundled=True)
    give(fake, own.id, person.subject_id)
    give(fake, taken.id, other.subject_id)
    page = browse(f"/subjects/{person.subject_id}").text
    assert f'href="/recordings/{own.id}"' in page
    assert re.findall(r'<option value="(\w+)"', page.partition("data-link")[2]) == [free.id]
    assert sample.id not in page
    assert f'href="/subjects/{person.subject_id}"' in browse(f"/recordings/{own.id}").text


def test_recordings_of_a_person_and_without_one_are_offered_page_by_page(fake: FakeService, browse: Browse) -> None:
    person = fake.subjects.add()
    own = [fake.add_recording(f"own {n}.c3d").id for n in range(53)]
    for recording_id in own:
        give(fake, recording_id, person.subject_id)
    free = [fake.add_recording(f"free {n}.c3d").id for n in range(53)]
    address = f"/subjects/{person.subject_id}"
    first = browse(address).text
    assert re.findall(r'name="recording" value="(\w+)"', first) == own[:2:-1]
    assert re.findall(r'<option value="(\w+)"', first.partition("data-link")[2]) == free[:2:-1]
    (older,) = re.findall(rf'href="({address}\?cursor=[^"]+)"', first)
    assert re.findall(r'name="recording" value="(\w+)"', browse(older).text) == own[2::-1]
    (others,) = re.findall(rf'href="({address}\?others=[^"]+)"', first)
    assert re.findall(r'<option value="(\w+)"', browse(others).text.partition("data-link")[2]) == free[2::-1]


def test_a_pseudonym_is_text_and_never_markup(fake: FakeService, browse: Browse) -> None:
    person = fake.subjects.add("<script>alert(1)</script>")
    give(fake, (recording := fake.add_recording()).id, person.subject_id)
    for address in ("/subjects", f"/subjects/{person.subject_id}", f"/recordings/{recording.id}"):
        page = browse(address).text
        assert "<script>alert" not in page
        assert "&lt;script&gt;alert" in page


def test_no_subjects_and_no_subject_of_that_name_have_a_sentence(browse: Browse) -> None:
    assert "No subjects yet." in browse("/subjects").text
    gone = browse("/subjects/gone")
    assert (gone.status_code, "There is no such subject." in gone.text) == (404, True)


def test_a_sample_offers_nothing_that_would_be_refused(fake: FakeService, browse: Browse) -> None:
    sample, own = fake.add_recording(bundled=True), fake.add_recording()
    assert browse(f"/recordings/{sample.id}").text.count('<fieldset class="bare" disabled>') == 6
    assert 'fieldset class="bare" disabled' not in browse(f"/recordings/{own.id}").text
