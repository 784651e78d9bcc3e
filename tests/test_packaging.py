import os
import re
import zipfile
from runpy import run_path

import pytest
from support.processes import finished

import release
import softrobot_env
from softrobot_env.robots import read_robot


@pytest.fixture(scope="module")
def wheel(tmp_path_factory, request):
    """The wheel, built offline with the build backend that is installed."""
    out = tmp_path_factory.mktemp("dist")
    command = ("-m", "build", "--wheel", "--no-isolation", "--outdir", out)
    finished(*command, request.config.rootpath, check=True)
    (path,) = out.glob("*.whl")
    return path


def test_wheel_carries_assets_models_and_firmware(wheel, request):
    names = set(zipfile.ZipFile(wheel).namelist())
    for folder in ("assets", "assets/robots", "models", "firmware/core", "firmware/host"):
        for path in (request.config.rootpath / folder).iterdir():
            assert path.is_dir() or f"softrobot_env/_data/{folder}/{path.name}" in names
    release.check_wheel(wheel)


@pytest.mark.slow
def test_wheel_works_outside_the_checkout(wheel, tmp_path):
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    code = (
        "import gymnasium, softrobot_env; from softrobot_env.core.files import assets_dir;"
        "env = gymnasium.make('SoftRobot/ArmSwing-v0'); env.reset(seed=0);"
        "env.step(env.action_space.sample());"
        "print(softrobot_env.__file__, assets_dir(), (assets_dir() / 'arm.xml').exists())"
    )
    done = finished(
        "-c", code, cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(site)}, check=True
    )
    package, assets, found = done.stdout.split()
    assert package.startswith(str(site)) and assets.startswith(str(site)) and found == "True"


@pytest.mark.parametrize(
    ("source", "shown"),
    (("", "*arm*"), ("https://a.b/c", "![arm](https://a.b/c/raw/HEAD/docs/x.gif)")),
)
def test_the_readme_of_an_index_has_no_relative_links(source, shown, request):
    text = (
        "<!-- figures {a} -->1<!-- end --> ![arm](docs/x.gif) [page](docs/y.md) [web](https://d.e)"
    )
    readme = run_path(str(request.config.rootpath / "hatch_build.py"))["readme"]
    found = readme(text, source)
    page = f"[page]({source}/blob/HEAD/docs/y.md)" if source else "page"
    assert found == f"1 {shown} {page} [web](https://d.e)"
    whole = (request.config.rootpath / "README.md").read_text(encoding="utf-8")
    assert not re.search(r"\]\((?!https:)", readme(whole, source))


def test_a_release_is_of_one_version(monkeypatch, tmp_path):
    assert release.version() == softrobot_env.__version__
    for name in ("softrobot_env/core/__init__.py", "CHANGELOG.md", "CITATION.cff"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text((release.ROOT / name).read_text())
    (tmp_path / "CITATION.cff").write_text("version: 0.0.1\n")
    monkeypatch.setattr(release, "ROOT", tmp_path)
    with pytest.raises(SystemExit, match=r"CITATION.cff has no line 'version: "):
        release.version()


def test_the_first_steps_are_those_of_the_readme(tmp_path):
    commands = release.first_steps()
    assert ["softrobot", "list"] in commands and len(commands) >= 3
    (tmp_path / "my.toml").write_text(release.robot_file())
    assert ["softrobot", "robot-file", "check", "my.toml"] in commands
    assert read_robot(tmp_path / "my.toml").name == "my_trunk"
    assert release.extras().startswith("[viz")
