"""Cycles of a Cortex-M4F, as published: the most that an instruction takes without wait states.

Arm Cortex-M4 Processor Technical Reference Manual (100166), tables of processor and FPU
instructions: a refill of the pipeline takes 1 to 3 cycles, and an arithmetic result of the FPU one
more where the next instruction uses it. Both are always taken at their most here.
"""

import re

REFILL = 3
# With the cycle for the next instruction's use of a result, and the refill after a branch.
CYCLES = {
    1: """adc add adds addw adr and ands asr asrs bfc bfi bic bics clz cmn cmp eor eors it ite itt
        itte itee ittt itet itett lsl lsls lsr lsrs mov movs movt movw mul muls mvn mvns neg negs
        nop orn orr orrs rev ror rors rsb rsbs sbc sbcs sbfx smull sub subs subw sxtb sxth teq tst
        ubfx umull uxtb uxth vcmp vcmpe vmrs vmsr""",
    2: """mla mls umlal smlal ldr ldrb ldrh ldrsb ldrsh str strb strh
        vabs vneg vadd vsub vmul vnmul vcvt""",
    3: "ldrd strd",
    4: """vmla vmls vnmla vnmls vfma vfms vfnma vfnms
        b bl bx blx cbz cbnz""",
    5: "tbb tbh",
    12: "sdiv udiv",
    15: "vdiv vsqrt",
}
COSTS = {name: cycles for cycles, names in CYCLES.items() for name in names.split()}
LISTS = {"ldm", "ldmia", "ldmdb", "stm", "stmia", "stmdb", "push", "pop"}
LISTS |= {"vldm", "vldmia", "vldmdb", "vstmdb", "vstm", "vstmia", "vpush", "vpop"}
CONDITION = re.compile("(?:eq|ne|cs|cc|hs|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le)$")


def most(instruction: str, operands: str) -> int:
    """Return the most cycles of an instruction, as a disassembler writes it."""
    name = instruction.split(".")[0]
    known = [*COSTS, *LISTS, "vmov", "vldr", "vstr"]
    name = name if name in known else CONDITION.sub("", name)
    refill = REFILL if re.match(r"pc\b", operands) or re.search(r"\bpc\}", operands) else 0
    if name in LISTS:
        return 1 + _words(operands) + refill
    if name in ("vldr", "vstr"):
        return 3 if operands.startswith("d") else 2
    if name == "vmov":
        return 2 if operands.count(",") > 1 or operands.startswith("d") else 1
    return COSTS[name] + refill


def _words(operands: str) -> int:
    """Return how many words a list of registers has."""
    count = 0
    for part in operands[operands.index("{") + 1 : operands.index("}")].split(","):
        ends = [int(n) for n in re.findall(r"[rsd](\d+)", part)]
        width = 2 if part.strip().startswith("d") else 1
        count += width * (ends[-1] - ends[0] + 1 if ends else 1)
    return count
