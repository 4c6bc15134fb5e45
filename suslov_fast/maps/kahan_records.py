"""The records of Kahan's map of fields, of its compositions, and of users' maps."""

from ..fields.field import Field
from ..fields.map import Map
from .formulas import KAHAN
from .map_records import MAPS, Discretization
from .orders import COMPOSITIONS, FIELD, OWN_MAP, field_in

for _record in (
    Discretization(
        name="Kahan",
        title="Kahan map of a quadratic field",
        body=Field,
        methods={"auto": FIELD, "order2": FIELD},
        formulas=KAHAN,
    ),
    *(
        Discretization(
            name=f"Kahan, order {order}",
            title=f"Composition of Kahan maps, order {order}",
            body=Field,
            methods={f"order{order}": field_in(COMPOSITIONS[order])},
            formulas=KAHAN,
            stages=COMPOSITIONS[order],
        )
        for order in COMPOSITIONS
    ),
    Discretization(name="Map", title="Map", body=Map, methods={"auto": OWN_MAP}, formulas={}),
):
    MAPS[_record.name] = _record
