// A Verilog board as a simulator for haptogram (docs/simulators.md), by Icarus Verilog.
//
// The board has a clock and a vector of pins, maybe a line to it and one from it. Their names, and
// the numbers, are given when this is compiled, and no parameter of the board needs a line here:
//   iverilog -g2005-sv -s simulator -DMODEL=board -DCLK=clk -DRX=rx -DPINS=pins -DCOUNT=16
//     -DPERIOD=25000 -DSTART=0 -DHALF_CLOCK_PS=15625 -o board.vvp icarus.v board.v
//   vvp -n board.vvp
// -DTX=tx for a board that answers. START: ns from power-up until it takes bytes.
`timescale 1ps / 1ps
`define TEXT(name) `"name`"

module simulator;
    localparam PERIOD_PS = `PERIOD * 1000;
    reg clk = 0, rx = 1;
    wire tx;
    wire [`COUNT-1:0] pins;
    reg [`COUNT-1:0] raw = 0, levels = 0, shown = 0;
    reg [64*8-1:0] text;
    reg [7:0] word, value;
    reg [9:0] coming, sent;
    // Bytes of the line wait in a ring; times are in ps.
    reg [63:0] begins [0:4095];
    reg [7:0] bytes [0:4095];
    integer first = 0, last = 0, n, sending = 0;
    reg [63:0] number, now = 0, until_ps = 0, period = PERIOD_PS, sample = 0, bit_ps = 0;

    `MODEL board (
        .`CLK(clk),
`ifdef RX
        .`RX(rx),
`endif
`ifdef TX
        .`TX(tx),
`endif
        .`PINS(pins)
    );

    task tell_periods(input [63:0] up_to);
        for (period = period; up_to >= period; period = period + PERIOD_PS) $display("|");
    endtask

    // A clock of the board: the line in, an edge, the pins and the line out.
    task run_clock;
        if (first != last && now >= begins[first]) begin
            coming = {1'b1, bytes[first], 1'b0};
            n = (now - begins[first]) / bit_ps;
            rx = n > 9 ? 1 : coming[n];
            if (n > 9) first = (first + 1) % 4096;
        end
        clk = 1;
        #(`HALF_CLOCK_PS) clk = 0;
        tell_periods(now);
        if (pins !== raw) begin
            raw = pins;
            for (n = 0; n < `COUNT; n = n + 1) levels[n] = pins[n] === 1;  // x and z are low
            if (levels != shown) $display("P %0d %h", (now + PERIOD_PS - period) / 1000, levels);
            shown = levels;
        end
`ifdef TX
        if (sending == 0 && tx === 0) begin
            sending = 10;
            sample = now + bit_ps / 2;
        end
        if (sending != 0 && now >= sample) begin
            sample = sample + bit_ps;
            sent[10 - sending] = tx;
            sending = sending - 1;
            if (sending == 0) begin
                $display("R %0d %h", now / 1000, sent[8:1]);
                until_ps = now;
            end
        end
`endif
        #(`HALF_CLOCK_PS) now = now + 2 * `HALF_CLOCK_PS;
    endtask

    initial begin
        while ($fgets(text, 32'h8000_0000) > 0) begin
            value = 0;
            n = $sscanf(text, "%c %d %h", word, number, value);
            if (word == "L") begin
                bit_ps = number * 1000;
                $display("hello 1\nby Icarus Verilog, %s\nperiod %0d\nstart %0d", `TEXT(`MODEL), `PERIOD, `START);
                $write("pins");
                for (n = 0; n < `COUNT; n = n + 1) $write(" %s%0d", `TEXT(`PINS), n);
                $display("\n. 0");
            end else if (word == "B") begin
                begins[last] = number * 1000;
                bytes[last] = value;
                last = (last + 1) % 4096;
            end else if (word == "T") begin
                until_ps = number * 1000;
                while (now <= until_ps) run_clock;
                tell_periods(until_ps);
                $display(". %0d", until_ps / 1000);
            end
            $fflush(32'h8000_0001);
        end
        $finish;
    end
endmodule
