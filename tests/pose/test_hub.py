"""Models that are shared: through a folder, and through the Hub's cache without a network."""

import hashlib

import pytest

from kfit.pose import CategoryModel
from kfit.pose.hub import CHECKSUM, MODEL


@pytest.fixture
def shared(tiny_model, tmp_path):
    return tiny_model.push_to_hub(tmp_path / "shared")


def test_a_model_comes_back_from_a_folder_with_its_card(tiny_model, shared):
    found = CategoryModel.from_pretrained(shared)
    assert found.card.known == tiny_model.card.known
    for name, weights in found.encoder.state_dict().items():
        # Files hold halves.
        assert (weights - tiny_model.encoder.state_dict()[name].half().float()).abs().max() == 0


def test_the_page_and_the_checksum_tell_of_the_model(tmp_path, shared):
    page = (tmp_path / "shared" / "README.md").read_text()
    assert "library_name: kfit" in page
    assert "Axes: " in page
    words = (tmp_path / "shared" / CHECKSUM).read_text().split()
    assert words == [hashlib.sha256((tmp_path / "shared" / MODEL).read_bytes()).hexdigest(), MODEL]


def test_a_model_that_was_replaced_is_refused(tmp_path, shared):
    file = tmp_path / "shared" / MODEL
    file.write_bytes(file.read_bytes()[:-1] + b"!")
    with pytest.raises(ValueError, match=r"model\.safetensors is damaged or was replaced: its SHA-256 begins with"):
        CategoryModel.from_pretrained(shared)


def test_folders_that_hold_no_model_say_what_is_missing(tmp_path, shared):
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match=r"it has no model\.safetensors"):
        CategoryModel.from_pretrained(tmp_path / "empty")
    (tmp_path / "shared" / CHECKSUM).unlink()
    with pytest.raises(FileNotFoundError, match=r"by which model\.safetensors is checked"):
        CategoryModel.from_pretrained(shared)
    with pytest.raises(FileNotFoundError, match="a repository is named as user/name"):
        CategoryModel.from_pretrained("nowhere")


def test_the_hub_s_cache_serves_without_a_network(tmp_path, shared, monkeypatch):
    constants = pytest.importorskip("huggingface_hub.constants")
    commit = "0" * 40
    repository = tmp_path / "cache" / "models--somebody--teapot"
    for folder in ("refs", f"snapshots/{commit}"):
        (repository / folder).mkdir(parents=True)
    (repository / "refs" / "main").write_text(commit)
    for name in (MODEL, CHECKSUM):
        (repository / "snapshots" / commit / name).write_bytes((tmp_path / "shared" / name).read_bytes())
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "cache"))
    assert CategoryModel.from_pretrained("somebody/teapot", offline=True).card.category == "mug"
    with pytest.raises(FileNotFoundError, match=r"somebody/other has no model\.safetensors that can be had"):
        CategoryModel.from_pretrained("somebody/other", offline=True)


def test_an_upload_hands_the_folder_to_the_hub(tiny_model, monkeypatch):
    hub = pytest.importorskip("huggingface_hub")
    received = {}
    monkeypatch.setattr(hub, "create_repo", lambda name, private, exist_ok: received.update(name=name, private=private))

    def upload(repo_id, folder_path, commit_message):
        received["files"] = sorted(path.name for path in folder_path.iterdir())
        return f"hub://{repo_id}"

    monkeypatch.setattr(hub, "upload_folder", upload)
    folder_of = {"README.md", MODEL, CHECKSUM}
    assert tiny_model.push_to_hub("somebody/teapot", private=True) == "hub://somebody/teapot"
    assert (received["name"], received["private"], set(received["files"])) == ("somebody/teapot", True, folder_of)
