"""Everything that the studies tell → one HTML file for a reader."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline import store
from pipeline.leaflet.page import Leaflet
from pipeline.studies.expansion import spelled_out
from stages import stage


@stage("page")
def main(cfg: DictConfig) -> str:
    leaflet = Leaflet.gather(Path(cfg.artifacts), spelled_out(cfg.benchmark), cfg.cells, Path(cfg.lock))
    with store.replace(cfg.out) as path:
        path.write_text(leaflet.html(), encoding="utf-8")
    lacks = f"; it lacks {len(leaflet.missing)} things, which it names: {leaflet.missing[0]}" if leaflet.missing else ""
    return f"{cfg.out}, {Path(cfg.out).stat().st_size / 1e6:.1f} MB; open it in a browser, it needs no network{lacks}"


if __name__ == "__main__":
    main()
