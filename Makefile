PYTHON ?= python3.11
VENV := .venv
RUN := $(VENV)/bin/python -m pipeline
