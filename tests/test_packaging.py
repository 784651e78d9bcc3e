import os
import zipfile

import pytest
from support.processes import finished


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
    folders = ("assets", "assets/robots", "models")
    for folder in (*folders, "firmware/core", "firmware/host", "firmware/avr"):
        for path in (request.config.rootpath / folder).iterdir():
            assert path.is_dir() or f"softrobot_env/_data/{folder}/{path.name}" in names
    assert not any("firmware/build" in name for name in names)
    assert not any(name.startswith(("tests/", "scripts/")) for name in names)


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
