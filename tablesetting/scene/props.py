"""Things that stand on the table, as composer entities."""

from typing import Final

from dm_control import composer, mjcf

from tablesetting.errors import TableSettingError
from tablesetting.scene import crockery, cutlery
from tablesetting.scene.prop_spec import Part, PropSpec

_VISUAL_GROUP: Final = 2
_COLLISION_GROUP: Final = 3  # Hidden by MuJoCo's viewers unless asked for.

PROPS: Final[dict[str, PropSpec]] = {
    spec.name: spec
    for spec in (
        crockery.PLATE,
        crockery.BOWL,
        crockery.CUP,
        crockery.GLASS,
        crockery.VASE,
        cutlery.FORK,
        cutlery.KNIFE,
        cutlery.SPOON,
    )
}
"""Every prop that a scene can hold, by name."""


class Prop(composer.Entity):
    """A rigid thing built from its `PropSpec`; attach it with a free joint."""

    def _build(self, spec: PropSpec) -> None:
        self._spec = spec
        self._mjcf_root = mjcf.RootElement(model=spec.name)
        self._add_solids()
        for index, part in enumerate(spec.parts):
            self._add_part(f"part_{index}", part)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """The MJCF model of this prop."""
        return self._mjcf_root

    @property
    def spec(self) -> PropSpec:
        """What this prop was built from."""
        return self._spec

    def _add_solids(self) -> None:
        density = self._spec.mass / sum(solid.volume for solid in self._spec.solids)
        for solid in self._spec.solids:
            self._mjcf_root.worldbody.add(
                "geom",
                type=solid.shape,
                size=solid.size,
                pos=solid.position,
                quat=solid.quaternion,
                mass=density * solid.volume,
                condim=self._spec.condim,
                group=_COLLISION_GROUP,
            )

    def _add_part(self, name: str, part: Part) -> None:
        assets = self._mjcf_root.asset
        mesh = assets.add(
            "mesh",
            name=name,
            # As a file in memory: inline numbers would swell the XML to megabytes.
            file=mjcf.Asset(part.mesh.to_stl(), extension=".stl"),
        )
        material = assets.add(
            "material",
            name=name,
            rgba=part.finish.rgba,
            specular=part.finish.specular,
            shininess=part.finish.shininess,
        )
        self._mjcf_root.worldbody.add(
            "geom",
            name=name,
            type="mesh",
            mesh=mesh,
            material=material,
            group=_VISUAL_GROUP,
            contype=0,
            conaffinity=0,
            mass=0,
        )


def make_prop(name: str) -> Prop:
    """Build a prop.

    Args:
        name: One of `PROPS`.

    Returns:
        A new, unattached entity.

    Raises:
        TableSettingError: If there is no prop of that name.
    """
    if name not in PROPS:
        raise TableSettingError(
            f"there is no prop called {name!r}; choose one of {', '.join(PROPS)}"
        )
    return Prop(PROPS[name])
