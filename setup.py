"""What pyproject.toml cannot say: the designs and studies of `data` are a folder of the installed package."""

from setuptools import find_namespace_packages, setup

setup(
    packages=[*find_namespace_packages(include=["pipeline*", "stages*"]), "pipeline.bundled"],
    package_dir={"pipeline.bundled": "data"},
)
